"""Scenes in space as dicflow measures them, against their exact truth, with the points of all draws of the noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dicflow.core.status import Status
from dicflow.engine.product import Product
from dicflow.pipeline import Result
from tests.scenes_in_space import scene
from tests.scenes_in_space.files import measured_results
from tests.scenes_in_space.specimen import Scene
from tests.scenes_in_space.truth import gauge_strain, material_of, rim_distance, truth

__all__ = ["QUANTITIES", "Measured", "MeasuredScene", "Row", "measured_scene", "measured_step", "row"]

QUANTITIES = {"U": 1e3, "V": 1e3, "W": 1e3, "exx": 1e6, "eyy": 1e6, "gxy": 1e6}
"""Factors to µm and µε."""


class Measured(NamedTuple):
    """The points of a region at one step, of one draw of the noise or of several.

    places : (n, 2) — in the first left photograph [px]
    error, stated : quantity → (n,) — errors and stated uncertainties [mm, -]; NaN where lost
    status : (n,)
    rim_px : (n,) — distance to the nearest edge, hole or crack in the first left photograph
    draw : (n,) — the draw of the noise
    subset_size : [px]
    """

    places: np.ndarray
    error: dict[str, np.ndarray]
    stated: dict[str, np.ndarray]
    status: np.ndarray
    rim_px: np.ndarray
    draw: np.ndarray
    subset_size: int

    @property
    def valid(self) -> np.ndarray:
        """Points (n,) with a value."""
        return self.status == Status.VALID

    @property
    def on_rim(self) -> np.ndarray:
        """Points (n,) whose subset may reach across a rim."""
        return self.rim_px < self.subset_size

    def of(self, selected: np.ndarray) -> Measured:
        """Some of the points (n,) bool."""
        error, stated = ({k: v[selected] for k, v in values.items()} for values in (self.error, self.stated))
        others = (array[selected] for array in (self.status, self.rim_px, self.draw))
        return Measured(self.places[selected], error, stated, *others, self.subset_size)


class Row(NamedTuple):
    """Figures of one quantity: shares [%] of all points that are valid, and of the errors of these; NaN without any.

    within_1, within_2, beyond_3 : stated uncertainties
    spread : standard deviation of within_1 over the draws of the noise; NaN for one draw
    stated, bias, rms : medians of what is stated and of the errors, and their root mean square [µm, µε]
    """

    points: int
    valid: float
    within_1: float
    within_2: float
    beyond_3: float
    spread: float
    stated: float
    bias: float
    rms: float


class MeasuredScene(NamedTuple):
    """A scene as it is measured.

    steps : points of the reported steps, of all draws; none where a run failed
    gauge_errors : of each extensometer the error of its strain over the strain, root mean square over the draws, at the
        reported step where that is largest
    """

    steps: dict[int, Measured]
    gauge_errors: dict[str, float]


def measured_scene(name: str, settings: Sequence[str] = ()) -> MeasuredScene:
    """A scene as it is measured with all draws of its noise. settings : as after ``--set``"""
    selected, draws, errors = scene(name), [], []
    for number, result in enumerate(measured_results(name, settings)):
        if result is None:
            return MeasuredScene({}, dict.fromkeys(selected.gauges, np.nan))
        draws.append([measured_step(selected, result, step, number) for step in selected.steps])
        errors.append([gauge_errors(selected, result, gauge) for gauge in selected.gauges])
    steps = dict(zip(selected.steps, map(pooled, zip(*draws, strict=True)), strict=True))
    usual = np.sqrt(np.mean(np.square(errors), axis=0))
    return MeasuredScene(steps, {gauge: float(usual[k].max()) for k, gauge in enumerate(selected.gauges)})


def pooled(draws: Sequence[Measured]) -> Measured:
    """The points of several draws of the noise."""
    error, stated = (
        {name: np.concatenate([values[name] for values in parts]) for name in QUANTITIES}
        for parts in zip(*((points.error, points.stated) for points in draws), strict=True)
    )
    places, status, rim_px, draw = (
        np.concatenate(parts)
        for parts in zip(*((points.places, points.status, points.rim_px, points.draw) for points in draws), strict=True)
    )
    return Measured(places, error, stated, status, rim_px, draw, draws[0].subset_size)


def gauge_errors(selected: Scene, result: Result, gauge: str) -> np.ndarray:
    """Relative errors of an extensometer's strain at the reported steps; NaN where it is not measured."""
    rows = [found for found in result.product("probes").attrs["rows"] if found["probe"] == gauge]
    exact = [gauge_strain(selected, selected.gauges[gauge], step) for step in selected.steps]
    found = [rows[step]["strain"] for step in selected.steps]
    return np.array(found, dtype=float) / exact - 1.0


def measured_step(selected: Scene, result: Result, step: int, draw: int = 0) -> Measured:
    """A scene at one step, against the truth. draw : number of its draw of the noise"""
    first, total = result.product("correlation", 0), result.product("total", result.steps("total")[step - 1])
    places = grid_places(first["xy"], first.attrs["step_size"])
    counts = first["status"] != Status.OUTSIDE
    places = places[counts]
    exact = truth(selected, material_of(selected, places), step)
    status = np.maximum(total["status"], first["status"])[counts]
    error, stated = {}, {}
    for name in QUANTITIES:
        error[name] = total[name][counts] - exact[name]
        stated[name] = total[stated_name(total, name)][counts]
    away, size = rim_distance(selected, places), first.attrs["subset_size"]
    return Measured(places, error, stated, status, away, np.full(len(places), draw), size)


def stated_name(total: Product, quantity: str) -> str:
    """The array that says how uncertain a quantity is: u, or σ of a total without it."""
    return f"u_{quantity}" if f"u_{quantity}" in total else f"sigma_{quantity}"


def grid_places(xy: np.ndarray, step_size: int) -> np.ndarray:
    """Places (row, col, 2) of all points of a regular grid, of which some (NaN) are unknown [px]."""
    rows, cols = xy.shape[:2]
    lattice = step_size * np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1)
    return lattice + np.nanmedian(xy - lattice, axis=(0, 1))


def row(points: Measured, quantity: str) -> Row:
    """Figures of one quantity."""
    factor = QUANTITIES[quantity]
    known = points.valid & np.isfinite(points.error[quantity])
    error, stated = points.error[quantity][known], points.stated[quantity][known]
    if not known.any():
        return Row(len(known), 0.0, *[np.nan] * 7)
    scaled = np.abs(error) / stated
    shares = (100.0 * part.mean() for part in (known, scaled < 1.0, scaled < 2.0, scaled > 3.0))
    sizes = np.median(stated), np.median(error), np.sqrt(np.mean(error**2))
    return Row(len(known), *shares, spread_of(scaled < 1.0, points.draw[known]), *(factor * size for size in sizes))


def spread_of(within: np.ndarray, draw: np.ndarray) -> float:
    """Standard deviation [%] over the draws of the share of points (n,) that are within; NaN for one draw."""
    shares = [100.0 * within[draw == number].mean() for number in np.unique(draw)]
    return float(np.std(shares, ddof=1)) if len(shares) > 1 else np.nan
