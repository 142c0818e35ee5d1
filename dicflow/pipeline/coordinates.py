"""Coordinates of datasets: places of the points at the first step, steps, times and the load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dicflow.kinds.channels import Channels
from dicflow.kinds.kind import GRID

if TYPE_CHECKING:
    import numpy as np
    import xarray

    from dicflow.engine.product import Product
    from dicflow.pipeline.result import Result

__all__ = ["with_places", "with_steps"]

Column = tuple[Any, dict[str, str]]
"""Values along the steps, and their attributes."""
_TIME = "time"
_LETTERS = "xyz"
_UNEVEN = 1e-3
"""Largest departure of a regular grid from one, relative to its step."""


def with_places(dataset: xarray.Dataset) -> xarray.Dataset:
    """A dataset of points with their places at the first step; any other as it is.

    ``x_px`` (col) and ``y_px`` (row), in the left photograph, where the points are a regular grid there; ``x_mm``,
    ``y_mm`` and ``z_mm`` (row, col), NaN where unknown, in the frame of the results.
    """
    found: dict[str, Any] = {}
    if "xy_reference" in dataset:
        found |= _lattice(_at_first(dataset["xy_reference"]).values)
    places = dataset.get("xyz_reference")
    if places is not None and places.units == "mm":
        for k, letter in enumerate(_LETTERS):
            part = _at_first(places)[..., k]
            attributes = {"units": "mm", "long_name": f"{letter} at the first step"}
            found[f"{letter}_mm"] = (GRID, part.data, attributes)
    return dataset.assign_coords(found)


def with_steps(
    dataset: xarray.Dataset, result: Result, stage: str, steps: Sequence[str], variant: int | str
) -> xarray.Dataset:
    """A dataset of one step, or of all along the dimension ``step``, that says which they are.

    ``step`` : number of the step in the test, 0 for the first photograph; ``step_name`` : its name; ``time`` [s] and
    ``load``, where a stage ``channels`` or the photographs know them.
    """
    columns: dict[str, Column] = {
        "step": ([result.number(stage, step, variant) for step in steps], {"long_name": "step"}),
        "step_name": (list(steps), {"long_name": "name of the step"}),
        **_channels(result, steps, variant),
    }
    if _TIME not in columns and (times := _times(result, steps, variant)):
        columns[_TIME] = (times, {"units": "s", "long_name": "time"})
    if "step" in dataset.dims:
        return dataset.assign_coords({name: ("step", *column) for name, column in columns.items()})
    return dataset.assign_coords({name: ((), values[0], attributes) for name, (values, attributes) in columns.items()})


def _at_first(places: xarray.DataArray) -> xarray.DataArray:
    """Places at the first of the steps; they are the same at all of them."""
    return places.isel(step=0) if "step" in places.dims else places


def _lattice(places: np.ndarray) -> dict[str, Any]:
    """Coordinates of the columns and rows of places (row, col, 2), where these are a regular grid with known points."""
    found: dict[str, Any] = {}
    for letter, dim, regular in (("x", "col", _regular(places[..., 0])), ("y", "row", _regular(places[..., 1].T))):
        if regular is None:
            return {}
        found[f"{letter}_px"] = (dim, regular, {"units": "px", "long_name": f"{letter} in the first left photograph"})
    return found


def _regular(values: np.ndarray) -> np.ndarray | None:
    """Values (row, col) that grow evenly with the column, the same in each row, as (col,); None for any others."""
    import numpy as np

    steps = np.diff(values, axis=1)
    if not np.isfinite(steps).any():
        return None
    step = float(np.nanmedian(steps))
    grown = step * np.arange(values.shape[1])
    start = values - grown
    is_even = np.nanmax(start) - np.nanmin(start) <= _UNEVEN * abs(step)
    return np.nanmedian(start) + grown if is_even else None


def _channels(result: Result, steps: Sequence[str], variant: int | str) -> dict[str, Column]:
    """Time and load at some steps, of the channels that have them."""
    found: dict[str, Column] = {}
    for product in _products(result, "channels", variant):
        channels = Channels.read(product)
        wished = {_TIME: _TIME, **({"load": channels.load} if channels.has_load else {})}
        for name, channel in wished.items():
            if channel in channels.names and set(steps) <= set(channels.steps):
                one = channels.of(channel)
                places = [channels.steps.index(step) for step in steps]
                found.setdefault(name, (one.values[places], {"units": one.unit, "long_name": one.title}))
    return found


def _products(result: Result, kind: str, variant: int | str) -> list[Product]:
    """Stored products of a kind that run once."""
    return [
        result.product(stage, None, variant) for stage in result.stages_of(kind) if result.has(stage, None, variant)
    ]


def _times(result: Result, steps: Sequence[str], variant: int | str) -> list[float]:
    """When the photographs of some steps were taken [s], as their cameras wrote it; empty where one is unknown."""
    for stage in result.stages_of("images"):
        if set(steps) <= set(result.steps(stage, variant)) and all(result.has(stage, step, variant) for step in steps):
            times = [result.attributes(stage, step, variant).get(_TIME) for step in steps]
            if None not in times:
                return [float(time) for time in times if time is not None]
    return []
