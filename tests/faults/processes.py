"""Processes that are killed: each runs one function of this module, and writes its output to a file."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

__all__ = ["Actor", "children", "main"]

ROOT = Path(__file__).resolve().parents[2]


class Actor:
    """A process, and the group of all that it starts.

    arguments : of the interpreter
    log : file of its output
    """

    def __init__(self, arguments: Sequence[object], log: Path) -> None:
        self.log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(
                [sys.executable, *map(str, arguments)],
                cwd=ROOT,
                stdout=output,
                stderr=output,
                start_new_session=True,
                env={**os.environ, "PYTHONPATH": str(ROOT)},
            )

    def wait_for(self, word: str, timeout_s: float = 60.0) -> bool:
        """Wait until a word is in the output, or the process has ended."""
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            if word in self.text or self.process.poll() is not None:
                return word in self.text
            time.sleep(0.005)
        return False

    @property
    def text(self) -> str:
        """Its output so far."""
        return self.log.read_text(errors="replace")

    def kill_group(self) -> None:
        """Kill the process and all that it has started."""
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def end(self, timeout_s: float = 60.0) -> int | None:
        """Wait for its end; None where it hangs, and is killed then."""
        try:
            return self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.kill_group()
            return None


def children(process: int) -> list[int]:
    """Numbers of all processes that a process has started, and of theirs."""
    parents = {int(path.name): _parent(path) for path in Path("/proc").iterdir() if path.name.isdigit()}
    found = [process]
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found[1:]


def _parent(path: Path) -> int:
    with suppress(OSError):
        return int((path / "stat").read_text().rpartition(")")[2].split()[1])
    return 0


def main(what: str, numbers: Path, store: Path, factor: float) -> None:
    """One act again and again, until it is killed; ``once-…`` once."""
    from dicflow.engine.housekeeping import collect
    from dicflow.engine.store import Store
    from dicflow.engine.verification import verify
    from dicflow.errors import DicflowError
    from tests.faults import chain

    acts = {
        "run": lambda: chain.run(numbers, store, factor),
        "processes": lambda: chain.run(numbers, store, factor, scheduler="processes", workers=2),
        "gc": lambda: collect(Store.open(store), keep_runs=1, delete=True, grace_s=0.0),
        "careful gc": lambda: collect(Store.open(store), keep_runs=1, delete=True),
        "verify": lambda: verify(Store.open(store), repair=True),
        "look": lambda: _sound(verify(Store.open(store))),
    }
    print("ready", flush=True)
    try:
        acts[what.removeprefix("once ")]()
        while not what.startswith("once "):
            factor += 1 / 8
            acts[what]()
    except DicflowError as error:
        sys.exit(str(error))


def _sound(damages: Sequence[object]) -> None:
    """End with a message if anything is damaged."""
    if damages:
        sys.exit(f"damaged: {damages}")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), float(sys.argv[4]))
