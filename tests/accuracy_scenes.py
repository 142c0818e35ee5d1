"""How true the stated uncertainties are in hard scenes: ``python -m tests.accuracy_scenes [SCENE …] [--set …]``.

Rendered scenes with exact truth are measured with the settings that ``dicflow init`` writes. For every scene, step
and quantity the table has the share of valid points, the shares of their errors within one and two and beyond three of
the stated uncertainties, the median and the root mean square of the errors, and the same for the points nearer than one
subset to an edge, a hole or a crack.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from dicflow.core.status import Status
from dicflow.engine.product import Product
from dicflow.pipeline import Result
from tests.bars import Figure
from tests.scenes_in_space import SCENES, scene
from tests.scenes_in_space.files import measured_result
from tests.scenes_in_space.specimen import Scene
from tests.scenes_in_space.truth import material_of, rim_distance, truth

__all__ = ["Measured", "Row", "measured", "row", "scenes"]

QUANTITIES = {"U": 1e3, "V": 1e3, "W": 1e3, "exx": 1e6, "eyy": 1e6, "gxy": 1e6}
"""Factors to µm and µε."""


class Measured(NamedTuple):
    """The points of a region at one step.

    places : (n, 2) — in the first left photograph [px]
    error, stated : quantity → (n,) — errors and stated uncertainties [mm, -]; NaN where lost
    status : (n,)
    rim_px : (n,) — distance to the nearest edge, hole or crack in the first left photograph
    subset_size : [px]
    """

    places: np.ndarray
    error: dict[str, np.ndarray]
    stated: dict[str, np.ndarray]
    status: np.ndarray
    rim_px: np.ndarray
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
        others = (array[selected] for array in (self.status, self.rim_px))
        return Measured(self.places[selected], error, stated, *others, self.subset_size)


class Row(NamedTuple):
    """Figures of one quantity: shares [%] of all points that are valid, and of the errors of these; NaN without any.

    within_1, within_2, beyond_3 : stated uncertainties
    stated, bias, rms : medians of what is stated and of the errors, and their root mean square [µm, µε]
    """

    points: int
    valid: float
    within_1: float
    within_2: float
    beyond_3: float
    stated: float
    bias: float
    rms: float


def measured(name: str, settings: Sequence[str] = ()) -> Iterator[tuple[int, Measured]]:
    """The reported steps of a scene as they are measured. settings : as after ``--set``"""
    result = measured_result(name, settings)
    if result is not None:
        selected = scene(name)
        for step in selected.steps:
            yield step, measured_step(selected, result, step)


def measured_step(selected: Scene, result: Result, step: int) -> Measured:
    """A scene at one step, against the truth."""
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
    return Measured(places, error, stated, status, rim_distance(selected, places), first.attrs["subset_size"])


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
        return Row(len(known), 0.0, *[np.nan] * 6)
    scaled = np.abs(error) / stated
    shares = (100.0 * part.mean() for part in (known, scaled < 1.0, scaled < 2.0, scaled > 3.0))
    sizes = np.median(stated), np.median(error), np.sqrt(np.mean(error**2))
    return Row(len(known), *shares, *(factor * size for size in sizes))


def print_step(name: str, step: int, points: Measured) -> None:
    """Print a line per quantity."""
    for quantity in QUANTITIES:
        parts = [row(points, quantity), row(points.of(points.on_rim), quantity)]
        text = "".join(
            f"{r.points:8}{r.valid:7.1f}{r.within_1:7.1f}{r.within_2:6.1f}{r.beyond_3:7.2f}"
            f"{r.stated:10.4g}{r.bias:10.3g}{r.rms:10.4g}"
            for r in parts
        )
        print(f"{name:<15}{step:>3} {quantity:<4}{text}", flush=True)


_COLUMNS = f"{'valid':>7}{'1u':>7}{'2u':>6}{'> 3u':>7}{'u':>10}{'bias':>10}{'rms':>10}"
_HEADING = f"{'scene':<15}step     {'points':>7}{_COLUMNS}{'rims':>8}{_COLUMNS}"


def scenes(names: Sequence[str] = SCENES, settings: Sequence[str] = ()) -> Iterator[Figure]:
    """Print the table, and give the figures of every scene's last step."""
    print(f"\nscenes in space; u as stated, errors in µm and µε\n{_HEADING}")
    for name in names:
        for step, points in measured(name, settings):
            print_step(name, step, points)
            yield Figure(f"{name}, step {step}: valid", 100.0 * points.valid.mean(), unit="%")
            beyond = max(row(points, quantity).beyond_3 for quantity in QUANTITIES)
            yield Figure(f"{name}, step {step}: largest share of errors beyond 3u", beyond, unit="%")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=f"of {', '.join(SCENES)}; all by default")
    parser.add_argument("--set", action="append", default=[], metavar="STAGE.PARAMETER=VALUE", help="another setting")
    given = parser.parse_args()
    list(scenes(given.scenes or SCENES, given.set))


if __name__ == "__main__":
    main()
