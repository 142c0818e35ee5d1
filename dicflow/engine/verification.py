"""Verification of a store: every file is read; damaged files are distinguished from unreadable ones."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

from dicflow.engine.files import FACTS
from dicflow.engine.hashing import digest_json
from dicflow.engine.housekeeping import GRACE_S, PINS
from dicflow.engine.integrity import GONE, check_product, reason_of
from dicflow.engine.journal import ABOUT, INDEX, RESULT, RunInfo
from dicflow.engine.layout import Found, Part, Survey, survey
from dicflow.engine.records import Record
from dicflow.engine.store import CODE, Store
from dicflow.engine.stored_json import Form, read_stored
from dicflow.engine.whole_file import NotRegularError

__all__ = ["Damage", "verify"]

_FORMS: dict[Part, Form] = {"files": FACTS, "latest": INDEX, "code": CODE}
_FORMS_IN_RUN = {"pipeline.json": ABOUT, "index.json": INDEX, "result.json": RESULT}


@dataclass(frozen=True)
class Damage:
    """A part of a store that is not as it was written.

    what : digest of a product, key of a record, else the path below the store's folder
    state : "damaged"; "unreadable": it cannot be read, so that nothing is known of it; "foreign": not of the store
    repaired : set aside or written again
    """

    what: str
    reason: str
    state: Literal["damaged", "unreadable", "foreign"] = "damaged"
    repaired: bool = False


class _Check(NamedTuple):
    """How one file or product is looked at.

    look : its damage as a message, "" if it is sound; raises OSError if it cannot be read, ValueError for a damage
    repair : None if it cannot be repaired
    """

    what: str
    path: Path
    look: Callable[[], str]
    repair: Callable[[], None] | None


def verify(store: Store, *, repair: bool = False) -> list[Damage]:
    """Read every file of a store; products and records are compared with their digests, others with their check sums.

    repair : set aside what is damaged, so that it is made again, and write again what can be; what cannot be read is
        left alone, and so is the file of pins. Products that only a run with a damaged index needed may then be freed.
    Raises StoreError if that fails.
    """
    seen = survey(store.path)
    found = [
        Damage(_below(store, path), f"{path}: cannot be listed ({reason_of(error)})", "unreadable")
        for path, error in seen.unreadable
    ]
    for check in _checks(store, seen):
        damage = _looked(check)
        if damage is not None and damage.state == "damaged" and repair and check.repair is not None:
            check.repair()
            damage = replace(damage, repaired=True)
        found += [] if damage is None else [damage]
    found += [Damage(_below(store, path), f"{path}: is not part of the store", "foreign") for path in seen.foreign]
    found += [Damage(_below(store, path), f"{path}: is a symbolic link", "foreign") for path in seen.links]
    return found


def _looked(check: _Check) -> Damage | None:
    """The damage that a check finds; None too for what another process has removed meanwhile."""
    try:
        reason = check.look()
    except GONE as error:
        reason = f"{check.path}: {reason_of(error)}"
    except OSError as error:
        return Damage(check.what, f"{check.path}: cannot be read ({reason_of(error)})", "unreadable")
    except ValueError as error:
        reason = f"{check.path}: {error}"
    return Damage(check.what, reason) if reason and os.path.lexists(check.path) else None


def _checks(store: Store, seen: Survey) -> Iterator[_Check]:
    if store.mark_state() == "damaged":
        yield _Check(store.mark.name, store.mark, lambda: f"{store.mark}: is damaged", store.write_mark)
    for path in seen.disguised:
        aside = None if path.name == "pins.json" else partial(store.set_aside, path)
        if path != store.mark:
            yield _Check(_below(store, path), path, partial(_disguised, path), aside)
    for found in seen.parts:
        yield from _checks_of(store, found)


def _checks_of(store: Store, found: Found) -> Iterator[_Check]:
    what, path = _below(store, found.path), found.path
    aside = partial(store.set_aside, path)
    if found.part == "manifest":
        look = partial(check_product, store, found.name)
        yield _Check(found.name, path, look, partial(store.quarantine, found.name))
    elif found.part == "record":
        yield _Check(found.name, path, partial(_record, found), aside)
    elif found.part in _FORMS:
        yield _Check(what, path, partial(_form, path, _FORMS[found.part]), aside)
    elif found.part == "actions":
        yield _Check(what, path, partial(_actions, store), partial(_repair_actions, store))
    elif found.part == "pins":
        yield _Check(what, path, partial(_form, path, PINS), None)
    elif found.part == "run":
        yield from _checks_of_run(store, RunInfo(found.name, path))


def _checks_of_run(store: Store, run: RunInfo) -> Iterator[_Check]:
    for name, form in _FORMS_IN_RUN.items():
        path = run.folder / name
        if os.path.lexists(path):
            yield _Check(_below(store, path), path, partial(_form, path, form), partial(store.set_aside, path))
    path = run.folder / "journal.jsonl"
    if os.path.lexists(path):
        in_progress = run.result is None and time.time() - path.lstat().st_mtime < GRACE_S
        repair = None if in_progress else partial(_repair_journal, store, run)
        yield _Check(_below(store, path), path, partial(_journal, run, in_progress), repair)


def _form(path: Path, form: Form) -> str:
    read_stored(path, form)
    return ""


def _record(found: Found) -> str:
    record = Record.read(found.path)
    fits = record.key == found.name == digest_json(record.parts)
    return "" if fits else f"{found.path}: the record does not fit its key"


def _actions(store: Store) -> str:
    count = store.index.damaged_lines()
    return f"{store.index.path}: {count} damaged lines" if count else ""


def _journal(run: RunInfo, in_progress: bool) -> str:
    """Damaged lines; the end of the last one may not have been written yet while the run is in progress."""
    damaged = [line for line, event in run.lines() if event is None]
    count = sum(line.endswith(b"\n") or not in_progress for line in damaged)
    return f"{run.folder / 'journal.jsonl'}: {count} damaged lines" if count else ""


def _disguised(path: Path) -> str:
    return f"{path}: something else stands in the place of a {'folder' if path.is_file() else 'file'}"


def _repair_actions(store: Store) -> None:
    with store.writing():
        store.index.keep_only(store.index.read().keys())


def _repair_journal(store: Store, run: RunInfo) -> None:
    path = run.folder / "journal.jsonl"
    with store.writing():
        try:
            sound = [line for line, event in run.lines() if event is not None]
        except NotRegularError:
            store.set_aside(path)
        else:
            store.replace(path, b"".join(sound))


def _below(store: Store, path: Path) -> str:
    return path.relative_to(store.path).as_posix()
