"""Changes of the user's files with undo: a file is written only as the page saw it, and no version is lost.

``history.json`` lists the changes, each with digests of the files before and after; ``versions/`` holds their bytes by
digest. A change that another program made meanwhile becomes an entry of its own as soon as a page has seen it.
"""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from dicflow.app.project import Project
from dicflow.errors import DicflowError, InputError
from dicflow.io.files import write_whole

__all__ = ["MISSING", "Conflict", "can", "change", "digest_of", "redo", "undo"]

MISSING = ""
"""The digest of a file that does not exist."""
_MOST = 1000
"""Changes that can be undone."""
_ELSEWHERE = "changed by another program"
_TURN = threading.Lock()
"""One change at a time, so that no two tabs pass the check before either has written."""

Entry = dict[str, Any]
"""``words``, and ``files``: name → [digest before, digest after]."""


class Conflict(DicflowError):
    """A file is no longer as the page saw it."""


def digest_of(project: Project, name: str) -> str:
    """Digest of a file of the project as it is now; MISSING without it. Raises InputError if it cannot be read."""
    content = _content(project, name)
    return MISSING if content is None else _digest(content)


def change(project: Project, seen: Mapping[str, str], new: Mapping[str, bytes], words: str) -> None:
    """Write files and remember what they were.

    seen : the digest of each file as the page has it
    words : what the change is, for the list of changes
    Raises Conflict where a file has changed meanwhile; nothing is written then.
    """
    with _TURN:
        history = _History(project)
        history.meet({name: seen.get(name, MISSING) for name in new})
        files = {name: [seen.get(name, MISSING), history.keep(content)] for name, content in new.items()}
        if changed := {name: pair for name, pair in files.items() if pair[0] != pair[1]}:
            history.write({name: pair[1] for name, pair in changed.items()})
            history.add({"words": words, "files": changed})


def undo(project: Project, seen: Mapping[str, str]) -> str:
    """Take back the last change and return its words, "" without any. Raises Conflict as :func:`change`."""
    return _stepped(project, seen, -1)


def redo(project: Project, seen: Mapping[str, str]) -> str:
    """Make the change again that was taken back last."""
    return _stepped(project, seen, 1)


def _stepped(project: Project, seen: Mapping[str, str], way: int) -> str:
    with _TURN:
        history = _History(project)
        history.meet(seen)
        return history.step(way)


def can(project: Project) -> dict[str, str]:
    """Words of the changes that undo and redo would go over; "" for none."""
    history = _History(project)
    return {
        "undo": history.entries[history.position - 1]["words"] if history.position else "",
        "redo": history.entries[history.position]["words"] if history.position < len(history.entries) else "",
    }


class _History:
    """The changes of a project; those from ``position`` on were taken back."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self.folder = project.folder / ".dicflow-app"
        self.entries: list[Entry] = []
        self.position = 0
        with suppress(OSError, ValueError, KeyError, TypeError):
            found = json.loads((self.folder / "history.json").read_text(encoding="utf-8"))
            entries, position = [_entry(one) for one in found["entries"]], int(found["position"])
            self.entries, self.position = entries, min(max(position, 0), len(entries))

    def meet(self, seen: Mapping[str, str]) -> None:
        """Raise Conflict where a file is not as it was seen; note what another program has made of it."""
        for name, digest in seen.items():
            content = _content(self.project, name)
            now = MISSING if content is None else _digest(content)
            if now != digest:
                raise Conflict(f"{name}: changed meanwhile by another program or page; look at it and edit it again")
            last = self._last(name)
            if content is not None and last is not None and last != now:
                self.add({"words": f"{name}: {_ELSEWHERE}", "files": {name: [last, self.keep(content)]}})
            elif content is not None and last is None:
                self.keep(content)

    def keep(self, content: bytes) -> str:
        """Keep a version and return its digest."""
        assert self.project.own_folder
        digest = _digest(content)
        path = self.folder / "versions" / digest
        if not path.exists():
            write_whole(path, content)
        return digest

    def write(self, versions: Mapping[str, str]) -> None:
        """Write kept versions to their files. Raises InputError if one is gone or cannot be written."""
        contents = {name: self._version(digest) for name, digest in versions.items() if digest != MISSING}
        for name, digest in versions.items():
            path = self.project.path(name)
            if digest == MISSING:
                path.unlink(missing_ok=True)
            else:
                write_whole(path, contents[name])

    def add(self, entry: Entry) -> None:
        """Append a change; what was taken back is forgotten."""
        self.entries[self.position :] = [entry]
        dropped, self.entries = self.entries[:-_MOST], self.entries[-_MOST:]
        self.position = len(self.entries)
        self._save()
        needed = {digest for one in self.entries for pair in one["files"].values() for digest in pair}
        for digest in {digest for one in dropped for pair in one["files"].values() for digest in pair} - needed:
            (self.folder / "versions" / digest).unlink(missing_ok=True)

    def step(self, way: int) -> str:
        """Go over one change, backwards or forwards. Raises Conflict where its files are not as it left them."""
        number = self.position - (way < 0)
        if not 0 <= number < len(self.entries):
            return ""
        files: dict[str, list[str]] = self.entries[number]["files"]
        before, after = (1, 0) if way < 0 else (0, 1)
        self.meet({name: pair[before] for name, pair in files.items()})
        self.write({name: pair[after] for name, pair in files.items()})
        self.position += way
        self._save()
        return str(self.entries[number]["words"])

    def _last(self, name: str) -> str | None:
        """The digest that the changes left a file with; None for a file that was never changed."""
        for number in range(self.position - 1, -1, -1):
            if name in self.entries[number]["files"]:
                return str(self.entries[number]["files"][name][1])
        later = (one["files"][name][0] for one in self.entries[self.position :] if name in one["files"])
        return next(later, None)

    def _version(self, digest: str) -> bytes:
        path = self.folder / "versions" / digest
        with suppress(OSError):
            content = path.read_bytes()
            if _digest(content) == digest:
                return content
        raise InputError(str(path), "this version is gone or damaged", "edit the file itself")

    def _save(self) -> None:
        assert self.project.own_folder
        text = json.dumps({"position": self.position, "entries": self.entries}, ensure_ascii=False)
        write_whole(self.folder / "history.json", text.encode())


def _entry(value: Any) -> Entry:
    """An entry of the history. Raises ValueError, KeyError or TypeError for what is none."""
    files = {str(name): [_hex(pair[0]), _hex(pair[1])] for name, pair in value["files"].items()}
    return {"words": str(value["words"]), "files": files}


def _hex(text: Any) -> str:
    if text != MISSING and (len(text) != 64 or set(text) - set("0123456789abcdef")):
        raise ValueError(text)
    return str(text)


def _content(project: Project, name: str) -> bytes | None:
    path = project.path(name)
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({(error.strerror or 'error').lower()})", "get access") from error


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
