"""The d specimen's displacement at the points where another program measured it."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import LinearNDInterpolator

from dicflow.core.cameras.rectification import raw_to_rectified, rectification
from dicflow.kinds.rig import rig_from_json
from dicflow.pipeline import Result


class Difference(NamedTuple):
    """share : of the reference's points that are covered; mean : (3,) U, V, W, ours less theirs [mm]"""

    share: float
    mean: np.ndarray


def difference(result: Result, folder: Path) -> Difference:
    """Displacement at the last step against ``reference/points_0273.csv``."""
    with (folder / "reference/points_0273.csv").open() as file:
        rows = list(csv.DictReader(file))
    column = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
    photographed = np.stack([column["x"], column["y"]], axis=-1)
    theirs = np.stack([column[f"tar_{axis}"] - column[f"ref_{axis}"] for axis in "xyz"], axis=-1)
    rig = rig_from_json(result.product("rig").attrs["rig"])
    frame = rectification(rig)
    places = raw_to_rectified(photographed, rig.left, frame.rotation_left, frame.matrix_left)
    total, grid = result.product("total", -1), result.product("track", 0)["points"]
    field = np.stack([total[name] for name in "UVW"], axis=-1)
    known = np.isfinite(field).all(axis=-1)
    ours = LinearNDInterpolator(grid[known], field[known])(places)
    seen = np.isfinite(ours).all(axis=1)
    return Difference(float(seen.mean()), (ours - theirs)[seen].mean(axis=0))
