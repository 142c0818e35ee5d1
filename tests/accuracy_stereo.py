"""How exact the subset correlation is in space: the five replicas against their strain, and real photographs."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CloughTocher2DInterpolator
from scipy.spatial import cKDTree

from dicflow.engine.product import Product
from dicflow.pipeline import Result
from dicflow.stages.deformation import Deformation
from tests.bars import Figure
from tests.data_folder import SHARED
from tests.figures import pipeline_result, print_table, replica

SMALL_STRAIN, SMALL_ERROR = 0.05, 5e-5
STRAINS = ("exx", "eyy")


class Fields(NamedTuple):
    """Errors of the strains of one step at its points, all (2, n) for exx and eyy.

    error : measured less true; bias : of the virtual strain gauge, from exact points; sigma : as predicted
    """

    error: np.ndarray
    bias: np.ndarray
    sigma: np.ndarray

    @property
    def over_bar(self) -> float:
        """Error over 1.2 σ and the gauge's bias, root mean squares over the points, the larger of both strains."""
        error, bias, sigma = (np.sqrt(np.mean(part**2, axis=1)) for part in self)
        return float((error / (1.2 * sigma + bias)).max())

    def share(self, sigmas: float) -> float:
        """Share of the points that the gauge's value is within so many σ of."""
        return float((np.abs(self.error - self.bias) < sigmas * self.sigma).mean())


def replicas() -> Iterator[Figure]:
    """The thesis's five experiments by correlation: an extensometer against the imposed strain at all 84 steps."""
    rows, shares, fields = [], [], []
    for number in range(1, 6):
        result = pipeline_result(f"precise_latex_experiment_{number}", replica(number), f"store_precise_{number}")
        rows += result.product("comparison").attrs["rows"]
        shares += [result.product("points", step).attrs["summary"]["valid_share"] for step in result.steps("points")]
        print(f"\nTable {5 + number} by subset correlation: experiment {number}")
        print_table(result.product("comparison").attrs["rows"])
        fields += list(strain_fields(result, dict(np.load(replica(number) / "truth/fields.npz"))))
    strain, error = (np.array([row[name] for row in rows], dtype=float) for name in ("caliper_strain", "strain_error"))
    large = strain >= SMALL_STRAIN
    yield Figure("replicas, precise: steps measured", int(np.isfinite(error).sum()), 84, at_least=True)
    worst = 100.0 * np.abs(error[large] / strain[large]).max()
    yield Figure("replicas, precise: largest error of the extensometer's strain", worst, 0.1, unit="%")
    yield Figure("  where the strain is below 0.05", np.abs(error[~large]).max(), SMALL_ERROR)
    yield Figure("replicas, precise: least share of valid points at a step", min(shares), 0.95, at_least=True)
    worst = max(found.over_bar for found in fields)
    yield Figure("replicas, precise: full-field strain error over 1.2 predicted σ + VSG bias", worst, 1.0)
    for sigmas in (1, 2):
        share = np.mean([100.0 * found.share(sigmas) for found in fields])
        yield Figure(f"  share of the points within {sigmas}σ, mean over the steps", share, unit="%")


def strain_fields(result: Result, truth: dict[str, np.ndarray]) -> Iterator[Fields]:
    """Every step but the first, printed as a table."""
    print(f"\n{'step':<10}{'error':>10}{'bias':>10}{'sigma':>10}  rms of eyy{'over bar':>10}{'1σ':>7}{'2σ':>7}")
    for step, name in enumerate(result.steps("total"), start=1):
        found = strain_field(result, truth, step)
        rms = (np.sqrt(np.mean(part[1] ** 2)) for part in found)
        print(f"{name:<10}" + "".join(f"{value:>10.2e}" for value in rms), end="")
        print(f"{found.over_bar:>22.2f}{found.share(1):>7.2f}{found.share(2):>7.2f}")
        yield found


def strain_field(result: Result, truth: dict[str, np.ndarray], step: int) -> Fields:
    """One step, against the truth at its points and against a gauge of the same windows over the exact points."""
    first, points = result.product("points", 0), result.product("points", step)
    total, grid = result.product("total", step - 1), result.product("correlation", 0)["xy"]
    before, after = (_true_at(truth, number, grid) for number in (0, step))
    gauge = Deformation().run(points=_exact(points, after), points_first=_exact(first, before))
    measured, smoothed, sigma = (
        np.stack([product[prefix + name] for name in STRAINS])
        for product, prefix in ((total, ""), (gauge, ""), (total, "sigma_"))
    )
    true = np.moveaxis(after[..., 3:], -1, 0)
    known = np.isfinite(measured + smoothed + sigma + true).all(axis=0)
    return Fields((measured - true)[:, known], (smoothed - true)[:, known], sigma[:, known])


def _true_at(truth: dict[str, np.ndarray], step: int, places: np.ndarray) -> np.ndarray:
    """X, Y, Z, exx and eyy (row, col, 5) of the points at places (row, col, 2) of the first left photograph."""
    values = np.concatenate([truth["xyz"][step], *(truth[name][step][..., None] for name in STRAINS)], axis=-1)
    smooth = CloughTocher2DInterpolator(truth["left_px"][0].reshape(-1, 2), values.reshape(-1, 5))
    return np.asarray(smooth(places))


def _exact(points: Product, truth: np.ndarray) -> Product:
    """Points as measured, at their true places."""
    xyz = points.variables["xyz"]
    exact = np.where(np.isfinite(xyz.values), truth[..., :3], np.nan)
    return Product("points", {**points.variables, "xyz": xyz._replace(values=exact)}, points.attrs)


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
