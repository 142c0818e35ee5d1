"""What `make accuracy` and `make bench` share: replicas on the disk, runs, and the table of figures."""

from __future__ import annotations

import atexit
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from dicflow.pipeline import Pipeline, Result
from dicflow.synth import latex_experiment, write_experiment
from tests.bars import Figure, print_figures

ROOT = Path(__file__).resolve().parents[1]
T = TypeVar("T")
WORK = ROOT / "build" / "figures"
_GONE = ROOT / "build" / "gone"


def report(figures: Iterable[Figure]) -> int:
    """Print the machine and the figures as they come; returns the exit code, 1 where a bar is missed."""
    print(f"\n{_processor()}, {os.cpu_count()} cores, Python {platform.python_version()}", flush=True)
    return print_figures(figures)


def _processor() -> str:
    """What the processor is called, as far as the system says."""
    names = Path("/proc/cpuinfo")
    lines = names.read_text().splitlines() if names.is_file() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def replica(experiment: int) -> Path:
    """Folder of a replica, made at the first call."""
    return made(
        f"replica_{experiment}", lambda folder: write_experiment(folder, latex_experiment(experiment), workers=2)
    )


def made(name: str, write: Callable[[Path], None]) -> Path:
    """A folder that is written at the first call."""
    folder = WORK / name
    done = folder / ".complete"
    if not done.is_file():
        print(f"making {folder.relative_to(ROOT)} …", file=sys.stderr)
        write(folder)
        done.touch()
    return folder


def fresh(name: str) -> Path:
    """A path of work in which nothing is left of an earlier time."""
    return cleared(WORK / name)


def cleared(path: Path) -> Path:
    """The path, of which nothing is there any more; what was there is deleted when the program ends.

    For minutes after many files are deleted, ext4 takes up to thirty times as long to make new ones beside them, which
    a measurement would count.
    """
    if path.exists():
        _GONE.mkdir(parents=True, exist_ok=True)
        path.rename(Path(tempfile.mkdtemp(dir=_GONE)) / path.name)
        atexit.register(shutil.rmtree, _GONE, ignore_errors=True)
    return path


def forth_and_back(values: Sequence[T], length: int) -> list[T]:
    """So many values: the given ones, back again, and so on."""
    cycle = [*values, *values[-2:0:-1]]
    return [cycle[k % len(cycle)] for k in range(length)]


def pipeline_result(name: str, data: Path, store: str, settings: Sequence[str] = ()) -> Result:
    """Run a pipeline of the repository; what is in the store already is not computed again."""
    return finished(
        Pipeline.load(ROOT / "pipelines" / f"{name}.yaml", data=data, store=WORK / store, settings=settings)
    )


def run_text(name: str, text: str, data: Path) -> Result:
    """Run a pipeline that is not worth a file of its own."""
    path = WORK / f"{name}.yaml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return finished(Pipeline.load(path, data=data, store=WORK / f"store_{name}"))


def finished(pipeline: Pipeline) -> Result:
    """The result of a run; ends the program where the run fails."""
    result = pipeline.run()
    assert result.outcome is not None
    if not result.outcome.ok:
        sys.exit("\n".join(result.outcome.errors))
    return result


def print_table(rows) -> None:
    columns = ("phase", "load_g", "caliper_length_mm", "caliper_displacement_mm", "caliper_strain", "dic_length_mm",
               "dic_displacement_mm", "dic_strain", "displacement_error_mm", "displacement_error_pct", "strain_error",
               "strain_error_pct")  # fmt: skip
    print("".join(f"{column.replace('displacement', 'disp').replace('caliper', 'cal'):>16}" for column in columns))
    for row in rows:
        values = [row.get(column, "") for column in columns]
        print("".join(f"{value:>16.4f}" if isinstance(value, float) else f"{value!s:>16}" for value in values))
