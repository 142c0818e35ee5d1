"""Flipped bits in every sort of file of a store."""

from __future__ import annotations

import random
import shutil
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from pathlib import Path

from dicflow.engine.housekeeping import collect, pin
from dicflow.engine.journal import runs
from dicflow.engine.store import Store
from dicflow.engine.verification import verify
from dicflow.errors import StoreError
from tests.faults import chain
from tests.faults.tally import Tally

__all__ = ["FILES", "flips", "power_failures"]

FILES = {
    "mark": "dicflow.json",
    "index of files": "files.index",
    "index of actions": "actions.index",
    "pins": "pins.json",
    "manifest": "objects/*/*.json",
    "record": "actions/*/*.json",
    "definitions": "code/*.json",
    "latest": "runs/latest/*.json",
    "description of a run": "runs/2*/pipeline.json",
    "index of a run": "runs/2*/index.json",
    "result of a run": "runs/2*/result.json",
    "journal": "runs/2*/journal.jsonl",
    "zarr.json of a group": "objects/*/*/zarr.json",
    "zarr.json of an array": "objects/*/*/*/zarr.json",
    "chunk": "objects/*/*/*/c.*",
}
"""Every sort of file."""


def flips(folder: Path, each: int) -> Iterator[Tally]:
    """Flip a bit of one file; look for it, use the store in every way, repair it."""
    numbers = chain.numbers(folder / "numbers")
    pristine = folder / "pristine"
    expected = chain.made_clean(numbers, pristine)
    pin(Store.open(pristine), "latest")
    chance = random.Random(20)
    for sort, pattern in FILES.items():
        tally = Tally(f"flipped bit: {sort}")
        for _ in range(each):
            tally.tried += 1
            store = folder / "store"
            shutil.copytree(pristine, store)
            path = chance.choice(sorted(store.glob(pattern)))
            note = f"{path.relative_to(store)} {_flip(path, chance)}"
            _use(tally, store, numbers, expected, note)
            shutil.rmtree(store)
        yield tally


def power_failures(folder: Path, count: int) -> Tally:
    """Many files of a run lost at once, as where the power fails before they are on the disk.

    A journaling file system may lose contents of new files, but no name before a later one: so the mark stays.
    """
    tally, numbers = Tally("power failure"), chain.numbers(folder / "numbers")
    pristine, store = folder / "pristine", folder / "store"
    expected = chain.made_clean(numbers, pristine)
    chance = random.Random(21)
    for _ in range(count):
        tally.tried += 1
        shutil.copytree(pristine, store)
        for path in sorted(path for path in store.rglob("*") if path.is_file()):
            _lose(path, chance)
        with chain.by_index() if tally.tried % 2 else nullcontext():
            tally.attempt(lambda: _looked_through(store), "ends badly")
            tally.attempt(lambda: chain.finished_well(numbers, store, expected), "wrong product")
        tally.attempt(lambda: _repaired(store), "ends badly")
        shutil.rmtree(store)
    return tally


def _lose(path: Path, chance: random.Random) -> None:
    """Leave a file as it is, or empty, cut short, full of zeros, or missing."""
    content = path.read_bytes()
    cut = chance.randrange(len(content))
    left = [content] * 4 + [b"", content[:cut], content[:cut] + bytes(len(content) - cut), None]
    chosen = chance.choice(left[:-1] if path.name == "dicflow.json" else left)
    path.unlink() if chosen is None else path.write_bytes(chosen)


def _flip(path: Path, chance: random.Random) -> str:
    """Flip one bit of a file; where."""
    content = bytearray(path.read_bytes())
    place, bit = chance.randrange(len(content)), chance.randrange(8)
    content[place] ^= 1 << bit
    path.write_bytes(content)
    return f"byte {place} bit {bit}"


def _use(tally: Tally, store: Path, numbers: Path, expected: chain.Expected, note: str) -> None:
    tally.attempt(lambda: _found(store), "not found", note)
    tally.attempt(lambda: _looked_through(store), "ends badly", note)
    with chain.by_index() if tally.tried % 2 else nullcontext():
        tally.attempt(lambda: chain.finished_well(numbers, store, expected), "wrong product", note)
    tally.attempt(lambda: _repaired(store), "ends badly", note)


def _found(store: Path) -> list[str]:
    """What keeps verify from finding one damage."""
    states = [found.state for found in verify(Store.open(store, create=False, accept_damaged=True))]
    return [] if states == ["damaged"] else [f"found {states}"]


def _looked_through(store: Path) -> list[str]:
    """Read everything that reports and maintenance read; a message for the user is a good end."""
    with suppress(StoreError):
        opened = Store.open(store)
        for run in runs(opened):
            list(run.events())
            _ = run.pipeline, run.started, run.resolved, run.result, run.index
        collect(opened, keep_runs=1, grace_s=0.0)
    return []


def _repaired(store: Path) -> list[str]:
    """What is left after repair; of pins nobody else knows, so their file is left."""
    verify(Store.open(store), repair=True)
    return [found.reason for found in verify(Store.open(store)) if found.what != "pins.json"]
