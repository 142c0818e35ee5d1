"""Writers at once, full disks, and stores that cannot be written."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dicflow.engine.store import Store
from dicflow.engine.verification import verify
from dicflow.errors import StoreError
from tests.faults import chain
from tests.faults.kills import ACTOR
from tests.faults.processes import Actor
from tests.faults.tally import Tally

__all__ = ["at_once", "full_disks", "read_only"]


def at_once(folder: Path, count: int, seconds: float) -> Tally:
    """Two writers of the same products, while a third process deletes and a fourth verifies."""
    tally = Tally("two writers, gc and verify at once")
    numbers = chain.numbers(folder / "numbers")
    expected = chain.made_clean(numbers, folder / "clean")
    for number in range(count):
        tally.tried += 1
        store = folder / f"store {number}"
        chain.run(numbers, store)
        acts = ("run", "run", "careful gc", "look")
        actors = [Actor([*ACTOR, act, numbers, store, 0.125], folder / f"log {k}") for k, act in enumerate(acts)]
        for actor in actors:
            actor.wait_for("ready")
        time.sleep(seconds)
        for act, actor in zip(acts, actors, strict=True):
            if actor.process.poll() is not None:
                tally.add("traceback" if "Traceback" in actor.text else "ends badly", f"{act}: {actor.text[-1500:]}")
            actor.kill_group()
        tally.attempt(lambda s=store: [found.reason for found in verify(Store.open(s))], "ends badly")
        tally.attempt(lambda s=store: chain.finished_well(numbers, s, expected), "wrong product")
    return tally


def full_disks(folder: Path, sizes_kb: range) -> Tally:
    """A run on disks of several sizes, and the next one after some space was freed."""
    tally = Tally("full disk")
    numbers = chain.numbers(folder / "numbers")
    expected = chain.made_clean(numbers, folder / "clean")
    for size in sizes_kb:
        tally.tried += 1
        with _disk(folder / "disk", f"size={size}k") as disk:
            if disk is None:
                tally.add("ends badly", "no small disk can be mounted here; run this as root")
                return tally
            tally.attempt(
                lambda d=disk: _messages(numbers, d / "store", "the disk is full"), "ends badly", f"{size} kB"
            )
            subprocess.run(["mount", "-o", "remount,size=20m", disk], check=True)
            tally.attempt(lambda d=disk: [one.reason for one in verify(Store.open(d / "store"))], "ends badly")
            tally.attempt(lambda d=disk: chain.finished_well(numbers, d / "store", expected), "wrong product")
    return tally


def read_only(folder: Path) -> Tally:
    """A store that cannot be written: hits are served, and all else ends with a message."""
    tally, numbers = Tally("read-only store"), chain.numbers(folder / "numbers")
    expected = chain.made_clean(numbers, folder / "clean")
    with _disk(folder / "disk", "size=20m") as disk:
        if disk is None:
            tally.add("ends badly", "no disk can be mounted here; run this as root")
            return tally
        shutil.copytree(folder / "clean", disk / "store")
        subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
        tally.tried += 3
        tally.attempt(lambda: chain.finished_well(numbers, disk / "store", expected), "wrong product")
        tally.attempt(lambda: [one.reason for one in verify(Store.open(disk / "store"))], "ends badly")
        tally.attempt(lambda: _messages(numbers, disk / "store", "cannot be written", 5.0), "ends badly")
    return tally


def _messages(numbers: Path, store: Path, word: str, factor: float = 2.0) -> list[str]:
    """Messages of a run that do not hold a word; a run that ends well has none."""
    try:
        errors = chain.run(numbers, store, factor).errors
    except StoreError as error:
        errors = [str(error)]
    return [error for error in errors if word not in error]


@contextmanager
def _disk(place: Path, options: str) -> Iterator[Path | None]:
    """A disk in the memory; None where none can be mounted."""
    place.mkdir(exist_ok=True)
    if os.geteuid() != 0 or subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", place]).returncode != 0:
        yield None
        return
    try:
        yield place
    finally:
        subprocess.run(["umount", place], check=True)
