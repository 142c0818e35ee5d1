"""Every reader on many changed files, each in a process of its own: ``python -m tests.fuzz [--inputs N] [TARGET …]``.

Run it with ``make fuzz``; the exit code is 1 if an input was handled wrongly. Such inputs are kept in ``build/fuzz``.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import tempfile
import time
from pathlib import Path

from tests.fuzz.harness import findings
from tests.fuzz.targets import targets

__all__ = ["main"]

_FOLDER = Path("build/fuzz")
_MOST_FINDINGS = 20
_SECONDS_EACH = 0.2
"""Mean time for an input, with room for a busy machine: a process that takes longer hangs."""
_START_SECONDS = 60.0


def main() -> int:
    """Print what is handled wrongly; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("--inputs", type=int, default=500, help="for each target")
    parser.add_argument("names", nargs="*", metavar="TARGET", help="words of the targets' names; default: all")
    options = parser.parse_args()
    chosen = [one.name for one in targets() if not options.names or any(word in one.name for word in options.names)]
    wrong = sum(_examined(name, options.inputs) for name in chosen)
    print(f"{len(chosen) * options.inputs:,} inputs for {len(chosen)} readers, {wrong} handled wrongly")
    return int(wrong > 0)


def _examined(name: str, count: int) -> int:
    """Number of inputs of a target that are handled wrongly; a process that hangs or dies is one more."""
    start = time.monotonic()
    process = multiprocessing.get_context("spawn").Process(target=_work, args=(name, count))
    process.start()
    process.join(_START_SECONDS + count * _SECONDS_EACH)
    wrong = process.exitcode
    if wrong is None or wrong < 0:
        process.kill()
        print(f"{name}: the process hangs, or has died ({wrong})")
        wrong = 1
    print(f"{name:32} {count:6,} inputs {wrong:4} wrong {time.monotonic() - start:6.1f} s", flush=True)
    return wrong


def _work(name: str, count: int) -> None:
    """Print and keep the findings; their number is the exit code."""
    target = next(one for one in targets() if one.name == name)
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        for wrong, one in enumerate(findings(target, count, Path(folder)), start=1):
            kept = _FOLDER / f"{name.replace(' ', '_')}_{one.number}"
            kept.parent.mkdir(parents=True, exist_ok=True)
            kept.write_bytes(one.data)
            print(f"{name}, input {one.number}, in {kept}:\n{one.problem}\n", flush=True)
            if wrong == _MOST_FINDINGS:
                break
    sys.exit(wrong)
