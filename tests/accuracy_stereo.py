"""How exact the subset correlation is in space: the five replicas against their strain, and real photographs."""

from __future__ import annotations

import csv
from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from dicflow.pipeline import Result
from tests.figures import SHARED, Figure, pipeline_result, print_table, replica

SMALL_STRAIN, SMALL_ERROR = 0.05, 5e-5


def replicas() -> Iterator[Figure]:
    """The thesis's five experiments by correlation: an extensometer against the imposed strain at all 84 steps."""
    rows, shares = [], []
    for number in range(1, 6):
        result = pipeline_result(f"precise_latex_experiment_{number}", replica(number), f"store_precise_{number}")
        rows += result.product("comparison").attrs["rows"]
        shares += [result.product("points", step).attrs["summary"]["valid_share"] for step in result.steps("points")]
        print(f"\nTable {5 + number} by subset correlation: experiment {number}")
        print_table(result.product("comparison").attrs["rows"])
    strain, error = (np.array([row[name] for row in rows], dtype=float) for name in ("caliper_strain", "strain_error"))
    large = strain >= SMALL_STRAIN
    yield Figure("replicas, precise: steps measured", int(np.isfinite(error).sum()), 84, at_least=True)
    worst = 100.0 * np.abs(error[large] / strain[large]).max()
    yield Figure("replicas, precise: largest error of the extensometer's strain", worst, 0.1, unit="%")
    yield Figure("  where the strain is below 0.05", np.abs(error[~large]).max(), SMALL_ERROR)
    yield Figure("replicas, precise: least share of valid points at a step", min(shares), 0.95, at_least=True)


def d_specimen() -> Iterator[Figure]:
    """A real steel part at the points where another program measured it, with that program's rig."""
    folder = SHARED / "d_specimen"
    result = pipeline_result("precise_d_specimen", folder, "store_precise_d")
    with (folder / "reference/points_0273.csv").open() as file:
        rows = list(csv.DictReader(file))
    column = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
    theirs = np.stack([column[f"tar_{axis}"] - column[f"ref_{axis}"] for axis in "xyz"], axis=-1)
    places = np.stack([column["x"], column["y"]], axis=-1)
    seen_there = np.stack([column["t1_x"], column["t1_y"]], axis=-1)
    ours, there, near = _at(result, places)
    yield Figure("d specimen, precise: share of the reference's points measured", near.mean(), 0.97, at_least=True)
    distance = np.linalg.norm(there - seen_there, axis=1)
    yield Figure("d specimen, precise: median difference in the left image", np.nanmedian(distance), 0.03, unit="px")
    for name, difference, bar in zip("UVW", np.abs(ours - theirs).T, (4.0, 4.0, 12.0), strict=True):
        yield Figure(
            f"d specimen, precise: median difference in {name}", 1e3 * np.nanmedian(difference), bar, unit="µm"
        )


def _at(result: Result, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement [mm] and place in the last left photograph [px] at places (n, 2) of the first, and where they are
    measured: a valid point of the grid within one step of it.

    Between the points of the grid, an affine fit to the nine nearest.
    """
    total, grid = result.product("total", -1), result.product("correlation", 0)["xy"]
    field = np.concatenate([np.stack([total[name] for name in "UVW"], axis=-1), total["xy"]], axis=-1)
    known = np.isfinite(field).all(axis=-1) & np.isfinite(grid).all(axis=-1)
    points, values = grid[known], field[known]
    distance, nearest = cKDTree(points).query(places, k=9)
    found = np.array([_affine(points[n] - place, values[n]) for n, place in zip(nearest, places, strict=True)])
    near = distance[:, 0] <= result.product("correlation", 0).attrs["step_size"]
    found[~near] = np.nan
    return found[:, :3], found[:, 3:], near


def _affine(offsets: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Value at the origin of the plane through values (n, m) at offsets (n, 2)."""
    matrix = np.column_stack([np.ones(len(offsets)), offsets])
    return np.asarray(np.linalg.lstsq(matrix, values, rcond=None)[0][0])
