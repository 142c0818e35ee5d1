"""Processes that are killed at random moments: in runs, workers, gc, verify, export and report."""

from __future__ import annotations

import os
import random
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

from dicflow.engine.store import Store
from dicflow.engine.verification import verify
from tests.faults import chain
from tests.faults.processes import Actor, children
from tests.faults.tally import Tally

__all__ = ["experiment_kills", "gc_kills", "group_kills", "run_kills", "verify_kills", "worker_kills"]

ACTOR = ("-m", "tests.faults.processes")
FACTORS = (0.125, 0.25, 0.375)


def run_kills(folder: Path, count: int) -> Tally:
    """A run in one process."""
    return _kills(Tally("kill: run in one process"), folder, count, "run", 0.6)


def group_kills(folder: Path, count: int) -> Tally:
    """A run in workers: all of its processes at once."""
    return _kills(Tally("kill: run with its workers"), folder, count, "processes", 4.0)


def gc_kills(folder: Path, count: int) -> Tally:
    """A deletion, with garbage of two runs each time."""

    def litter(numbers: Path, store: Path, number: int) -> None:
        for factor in (number + 0.5, number + 0.75, 2.0):
            chain.run(numbers, store, factor)

    return _kills(Tally("kill: gc"), folder, count, "once gc", 0.03, litter)


def verify_kills(folder: Path, count: int) -> Tally:
    """A repair, with three damaged files each time."""
    chance = random.Random(3)

    def damage(numbers: Path, store: Path, _number: int) -> None:
        chain.run(numbers, store)
        for pattern in ("objects/*/*.json", "actions/*/*.json", "objects/*/*/*/c.*"):
            path = chance.choice(sorted(store.glob(pattern)))
            path.write_bytes(path.read_bytes()[:-7])

    return _kills(Tally("kill: verify --repair"), folder, count, "once verify", 0.05, damage)


def _kills(
    tally: Tally,
    folder: Path,
    count: int,
    what: str,
    longest_s: float,
    prepare: Callable[[Path, Path, int], None] | None = None,
) -> Tally:
    """Kill one act after another on one store. longest_s : after its start"""
    numbers, store = chain.numbers(folder / "numbers"), folder / "store"
    clean = {factor: chain.made_clean(numbers, folder / f"clean {factor}", factor) for factor in (*FACTORS, 2.0)}
    chance = random.Random(7)
    for number in range(count):
        tally.tried += 1
        if prepare is not None:
            prepare(numbers, store, number)
        actor = Actor([*ACTOR, what, numbers, store, 0.125], folder / "log")
        actor.wait_for("ready")
        time.sleep(chance.uniform(0.0, longest_s))
        actor.kill_group()
        _look_at(tally, actor, store, repaired=what == "once verify")
        factor = chance.choice([*FACTORS, 2.0])
        tally.attempt(lambda f=factor: chain.finished_well(numbers, store, clean[f], f), "wrong product")
    return tally


def _look_at(tally: Tally, actor: Actor, store: Path, repaired: bool = False) -> None:
    """A killed process has printed no traceback, and damaged nothing."""
    if "Traceback" in actor.text:
        tally.add("traceback", actor.text[-1500:])
    if repaired:
        verify(Store.open(store), repair=True)
    tally.attempt(lambda: [found.reason for found in verify(Store.open(store))], "ends badly")


def worker_kills(folder: Path, count: int) -> Tally:
    """One process of a run's workers; the run must go on, or end by itself."""
    tally, numbers = Tally("kill: a single worker"), chain.numbers(folder / "numbers")
    expected = chain.made_clean(numbers, folder / "clean")
    chance = random.Random(11)
    for number in range(count):
        tally.tried += 1
        store = folder / f"store {number}"
        actor = Actor([*ACTOR, "once processes", numbers, store, 2.0], folder / "log")
        actor.wait_for("ready")
        time.sleep(chance.uniform(1.0, 4.0))
        workers = children(actor.process.pid)
        with suppress(ProcessLookupError):
            os.kill(chance.choice(workers or [actor.process.pid]), signal.SIGKILL)
        if actor.end(90.0) is None:
            tally.add("ends badly", f"hangs after the kill of one of {len(workers)} processes")
        _look_at(tally, actor, store)
        tally.attempt(lambda s=store: chain.finished_well(numbers, s, expected), "wrong product")
        shutil.rmtree(store, ignore_errors=True)
    return tally


def experiment_kills(folder: Path, count: int) -> Iterator[Tally]:
    """Export and report of a small experiment."""
    from tests.small import photograph_experiment

    pipeline = photograph_experiment(folder / "experiment")
    _finished(["run", pipeline, "--scheduler", "sync", "--workers", 1, "--output", folder / "results"], folder)
    for command in ("export", "report"):
        yield _command_kills(pipeline, command, folder, count)


def _command_kills(pipeline: Path, command: str, folder: Path, count: int) -> Tally:
    tally, chance, output = Tally(f"kill: {command}"), random.Random(13), folder / command
    arguments = [command, pipeline, *(["--force"] if command == "export" else [])]
    started = time.monotonic()
    _finished([*arguments, "--output", folder / f"clean {command}"], folder)
    whole_s = time.monotonic() - started
    for _ in range(count):
        tally.tried += 1
        if chance.random() < 0.3:
            shutil.rmtree(output, ignore_errors=True)
        actor = Actor(["-m", "dicflow", *arguments, "--output", output], folder / "log")
        time.sleep(chance.uniform(0.3 * whole_s, whole_s))
        actor.kill_group()
        _look_at(tally, actor, pipeline.parent / ".dicflow")
        tally.attempt(lambda: _half_files(output, folder / f"clean {command}"), "wrong product")
    _finished([*arguments, "--output", output], folder)
    tally.attempt(lambda: [str(path) for path in output.rglob("*") if ".part" in path.name], "ends badly")
    tally.attempt(lambda: [str(path) for path in output.glob(".export-*")], "ends badly")
    return tally


def _half_files(output: Path, clean: Path) -> list[str]:
    """Files with their final names that are not as they should be; a page differs in the time of its making."""
    found = []
    for path in (path for path in output.glob("*") if path.is_file() and ".part" not in path.name):
        whole = (clean / path.name).read_bytes()
        same = path.read_bytes() == whole
        if not same and not (path.suffix == ".html" and path.read_bytes().rstrip().endswith(b"</html>")):
            found.append(f"{path.name}: differs")
    return found


def _finished(arguments: list[object], folder: Path) -> None:
    """Run a command to its end. Raises RuntimeError if it fails."""
    actor = Actor(["-m", "dicflow", *arguments], folder / "log")
    if actor.end(600.0) != 0:
        raise RuntimeError(actor.text)
