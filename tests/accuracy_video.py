"""Two VP9 videos of a test, 600 frames at 30/s and 500 at 25/s, 0.37 s apart, from ``init`` to the report.

``python -m tests.accuracy_video [FOLDER]`` renders them, runs the two commands, and prints how far the clocks'
offset and the extensometer's strain are from the truth. It ends with 1 where the offset differs by more than 0.3
frames, or the strain by more than 0.2 % of its largest value, root mean square over the steps.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dicflow.core.synthetic.trace import material_at
from dicflow.io.configuration import parse
from dicflow.kinds.images import Images
from dicflow.kinds.probes import ProbeTable
from dicflow.pipeline import Pipeline
from tests.bars import Figure, print_figures
from tests.video_scene import LENGTH, Film, film, write_boards, write_videos

OFFSET, RATES, FRAMES = 0.37, (30.0, 25.0), (600, 500)
COMMANDS = (("init", ".", "--square", "4.5 mm"), ("run", "pipeline.yaml"))


class Strains(NamedTuple):
    """Strain of the extensometer at each step, and the truth."""

    found: np.ndarray
    truth: np.ndarray

    @property
    def errors(self) -> np.ndarray:
        """Differences over the largest strain."""
        return (self.found - self.truth) / np.abs(self.truth).max()


def figures(folder: Path) -> Iterator[Figure]:
    """Render, run, and compare with the truth."""
    scene = film(OFFSET)
    write_videos(folder, scene, FRAMES, RATES, "VP90")
    write_boards(folder, scene)
    said = "".join(_ran(command, folder) for command in COMMANDS)
    yield Figure("offset of the clocks, error", abs(_offset(said) - OFFSET) * max(RATES), 0.3, unit="frames")
    strains = _strains(folder, scene)
    yield Figure("steps", len(strains.found))
    yield Figure("strain in the end", strains.truth[-1])
    yield Figure(
        "strain, error over the largest: root mean square", 100 * np.sqrt((strains.errors**2).mean()), 0.2, unit="%"
    )
    yield Figure("... largest of all steps", 100 * np.abs(strains.errors).max(), unit="%")
    yield Figure("report", _report(folder), 15.0, unit="MB")


def _ran(command: tuple[str, ...], folder: Path) -> str:
    """What a command says; it must succeed."""
    done = subprocess.run(
        [sys.executable, "-m", "dicflow", *command], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def _offset(said: str) -> float:
    """The offset that a run has found [s]."""
    found = re.search(r"offset: ([-\d.]+)", said)
    assert found is not None, said
    return float(found[1])


def _strains(folder: Path, scene: Film) -> Strains:
    path = folder / "pipeline.yaml"
    ends = parse(path.read_text(), path.name).data["stages"]["probes"]["extensometers"]["along_load"]
    result = Pipeline.load(path).result()
    times = [Images.read(result.product("photos", step)).time for step in result.steps("photos")]
    start = (0.0, LENGTH / 2.0)
    material = material_at(scene.stand.rig.left, scene.state(times[0]), np.array(ends, dtype=float), start=start)
    truth = np.array([scene.strain(time, times[0], material) for time in times])
    return Strains(ProbeTable.read(result.product("probes")).of_extensometer("along_load", "strain"), truth)


def _report(folder: Path) -> float:
    """Size of the report [MB]."""
    return (folder / "results" / "pipeline" / "report.html").stat().st_size / 1e6


if __name__ == "__main__":
    if len(sys.argv) > 1:
        place = Path(sys.argv[1])
        place.mkdir(parents=True, exist_ok=True)
        sys.exit(print_figures(figures(place)))
    with tempfile.TemporaryDirectory() as temporary:
        sys.exit(print_figures(figures(Path(temporary))))
