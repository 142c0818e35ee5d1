"""Results with many steps and points for benches: a stage of another package gives fields that are formulas."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from tests.installed import Site

__all__ = ["COLS", "ROWS", "environment", "long_results"]

ROWS, COLS = 200, 250
DISTINCT = 200
"""Steps that differ; longer tests repeat them, so that a store of 3,000 steps takes 1 GB."""
SIZE = (4000, 3000)
STAGE = f'''
from typing import ClassVar, Literal

import numpy as np

from dicflow.engine.node import Keep, Node, Port, Scope, keeping
from dicflow.kinds.total import Total, TotalFacts

STRAINS = ("exx", "eyy", "gxy", "e1", "e2")

class Waves(Node):
    """Fields that are waves with noise, larger at each step; the first pixel of the photograph is the step."""

    title: ClassVar = "waves"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {{"images": Port("images")}}
    gives: ClassVar = "total"
    stage: Literal["waves"] = "waves"
    keep: Keep = keeping("always")

    def run(self, images):
        number = int(images["left"][0, 0])
        rng = np.random.default_rng(number)
        rows, cols = np.mgrid[0:{ROWS}, 0:{COLS}].astype(float)
        x, y = cols / {COLS}, rows / {ROWS}
        status = np.zeros(x.shape, np.uint8)
        status[:, 40::97] = 2
        names = ("U", "V", *STRAINS)
        fields = {{name: number * 1e-3 * np.sin((3 + k) * x) * np.cos(2 * y) + rng.normal(0, 1e-4, x.shape)
                  for k, name in enumerate(names)}}
        fields |= {{f"sigma_{{name}}": 1e-4 * rng.uniform(0.8, 1.2, x.shape) for name in names}}
        first = np.stack([100 + 15 * cols, 100 + 14 * rows], axis=-1)
        fields["xy"], fields["xy_reference"] = first + np.stack([fields["U"], fields["V"]], axis=-1), first
        for values in fields.values():
            values[status == 2] = np.nan
        further = {{"step_size": 15.0, "summary": {{}}}}
        return Total.write(fields, status, TotalFacts("precise", "px", {{}}, further))
'''
PIPELINE = """dicflow: 1
stages:
  photos: {{stage: images, left: "{folder}/*.tif"}}
  region: {{stage: region, images: photos, rectangle: [90, 90, 3900, 2900]}}
  fields: {{stage: waves, images: photos}}
"""


def environment(folder: Path) -> Mapping[str, str]:
    """For processes that know the stage of the results in a folder."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder / "site"), os.environ.get("PYTHONPATH", "")])}


def long_results(folder: Path, counts: Sequence[int]) -> list[Path]:
    """Pipeline files beside photographs of 12 megapixels, measured; one for each number of steps."""
    points = {"dicflow.stages": {"waves": "waves_stage:Waves"}}
    Site(folder / "site").install("waves-stage", {"waves_stage.py": STAGE}, points)
    photographs = [_photograph(folder / "photographs", number) for number in range(min(DISTINCT, max(counts)))]
    paths = [_pipeline(folder, count, photographs) for count in counts]
    code = (
        "import sys; from dicflow.pipeline import Pipeline; "
        "assert all(Pipeline.load(path).run(scheduler='sync').outcome.ok for path in sys.argv[1:])"
    )
    subprocess.run([sys.executable, "-c", code, *paths], check=True, env=environment(folder), stderr=subprocess.DEVNULL)
    return paths


def _photograph(folder: Path, number: int) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / f"step_{number:04}.tif"
    width, height = SIZE
    coarse = np.random.default_rng(1).integers(0, 256, (height // 4, width // 4), dtype=np.uint8)
    grey = np.repeat(np.repeat(coarse, 4, axis=0), 4, axis=1)
    grey[0, 0] = number
    Image.fromarray(grey).save(path)
    return path


def _pipeline(folder: Path, count: int, photographs: Sequence[Path]) -> Path:
    """A pipeline file over so many photographs; those that repeat are names of the same files."""
    name = f"steps_{count}"
    (folder / name).mkdir()
    for number in range(count):
        os.link(photographs[number % len(photographs)], folder / name / f"step_{number:04}.tif")
    path = folder / f"{name}.yaml"
    path.write_text(PIPELINE.format(folder=name))
    return path
