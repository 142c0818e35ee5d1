"""What a person waits for: whole commands, from the first run of an installation to one with nothing to do.

Part of ``make bench``. ``BEFORE=FOLDER/bin/dicflow`` names the program of another commit, which then does the same in
turn with this one; its seconds and their ratio stand below each figure. Bars are for two cores of a server.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.bars import Figure
from tests.data_folder import SHARED
from tests.figures import ROOT, fresh, replica, report

PROGRAM = str(Path(sys.executable).with_name("dicflow"))
BEFORE = os.environ.get("BEFORE", "")
REPEATS = 3


class Wait(NamedTuple):
    """Something a person waits for.

    name : of the figure; bar : most seconds
    arguments : of the command; "{store}" and "{output}" stand for folders of the program's own
    first : arguments of a command that is done before, not measured; empty for none
    is_first : whether nothing is compiled yet
    """

    name: str
    bar: float
    arguments: Sequence[str]
    first: Sequence[str] = ()
    is_first: bool = False
    repeats: int = REPEATS


def command(pipeline: str, data: Path, *settings: str) -> list[str]:
    """Arguments that run a pipeline of the repository."""
    return [
        "run",
        str(ROOT / "pipelines" / f"{pipeline}.yaml"),
        *("--data", str(data)),
        *("--store", "{store}"),
        *("--output", "{output}"),
        *settings,
    ]


def waits() -> Iterator[Wait]:
    """Everything that is measured; real photographs where they are."""
    quick, window = command("quickstart", ROOT / "data_samples"), "total.window=60 px"
    yield Wait("quick start, first run of an installation", 25.0, quick, is_first=True, repeats=1)
    yield Wait("quick start, empty store", 10.0, quick)
    yield Wait("quick start, one window changed", 2.0, [*quick, "--set", window], quick)
    yield Wait("quick start, nothing to do", 0.6, quick, quick)
    yield Wait("dicflow --help", 0.15, ["--help"])
    specimen = SHARED / "d_specimen"
    if specimen.is_dir():
        yield Wait("two cameras, 7 real pairs", 9.0, command("precise_d_specimen", specimen))
    data = replica(1)
    precise = command("precise_latex_experiment_1", data)
    yield Wait("replica of 22 pairs, precise form", 28.0, precise, repeats=1)
    yield Wait("replica, one window changed", 9.0, [*precise, "--set", window], precise, repeats=1)
    yield Wait("replica of 22 pairs, thesis form", 50.0, command("latex_experiment_1", data), repeats=1)


def seconds(program: str, wait: Wait) -> float:
    """Seconds of the whole process, from an empty store."""
    folder = fresh(f"waits_{'now' if program == PROGRAM else 'before'}")
    home = {"HOME": str(folder), "XDG_CACHE_HOME": "", "LOCALAPPDATA": ""} if wait.is_first else {}
    if wait.is_first and program != PROGRAM:  # whose kernels may lie beside its code
        home["NUMBA_CACHE_DIR"] = str(folder / "kernels")
    environment = {**os.environ, **home}
    folders = {"store": str(folder / "store"), "output": str(folder / "output")}
    if wait.first:
        _done([program, *(part.format(**folders) for part in wait.first)], environment)
    begin = time.perf_counter()
    _done([program, *(part.format(**folders) for part in wait.arguments)], environment)
    return time.perf_counter() - begin


def _done(arguments: Sequence[str], environment: Mapping[str, str]) -> None:
    finished = subprocess.run(arguments, capture_output=True, text=True, check=False, env=environment)
    if finished.returncode:
        sys.exit(f"{' '.join(arguments)} ended with {finished.returncode}:\n{finished.stderr}")


def figures() -> Iterator[Figure]:
    """Medians of whole processes, and of those of another commit in turn with them."""
    for wait in waits():
        both = [[seconds(program, wait) for program in (PROGRAM, BEFORE) if program] for _ in range(wait.repeats)]
        now, *before = np.median(both, axis=0)
        yield Figure(f"{wait.name}, whole process", now, wait.bar, unit="s")
        for other in before:
            yield Figure("  the same by the other commit", other, unit="s")
            yield Figure("  this / other commit", now / other)


if __name__ == "__main__":
    sys.exit(report(figures()))
