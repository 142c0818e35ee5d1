"""What is known of a step from one reading: extents, colour ranges, means, and how many points have which status."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypedDict

import numpy as np
from numpy.typing import NDArray

from dicflow.core.status import Status
from dicflow.explorer.fields import ERROR_PARTS, StepFields
from dicflow.explorer.packing import LinearScale, LogScale
from dicflow.kinds.maps import colour_range

__all__ = ["Scales", "StepSurvey", "extents", "scales_of", "survey", "valid_share"]

Array = NDArray[Any]
Extent = tuple[float, float]


class StepSurvey(TypedDict):
    """Facts of one step, as JSON.

    shape : rows and columns of the grid
    values : quantity → least and largest number
    errors : each of ``ERROR_PARTS`` → quantity → least and largest positive number
    colours : quantity → range without outliers
    means : quantity → mean over the points, and their standard deviation about it
    places : place → least and largest number of each component
    counts : status code, as text → number of points inside the region
    """

    shape: tuple[int, int]
    values: dict[str, Extent]
    errors: dict[str, dict[str, Extent]]
    colours: dict[str, Extent]
    means: dict[str, Extent]
    places: dict[str, list[Extent]]
    counts: dict[str, int]


class Scales(NamedTuple):
    """How numbers of all steps become codes, by quantity and by place; errors by each of ``ERROR_PARTS`` before."""

    values: Mapping[str, LinearScale]
    errors: Mapping[str, Mapping[str, LogScale]]
    places: Mapping[str, Sequence[LinearScale]]


def survey(fields: StepFields, inside: Array | None) -> StepSurvey:
    """Facts of one step.

    inside : (row, col) bool — points in the region; None for those whose status is not "outside"
    """
    known = {name: values[np.isfinite(values)] for name, values in fields.values.items()}
    known = {name: values for name, values in known.items() if values.size}
    codes, numbers = np.unique(
        fields.status[fields.status != Status.OUTSIDE if inside is None else inside], return_counts=True
    )
    return StepSurvey(
        shape=(fields.status.shape[0], fields.status.shape[1]),
        values={name: (float(values.min()), float(values.max())) for name, values in known.items()},
        errors={part: _positive_extents(fields.errors.get(part, {})) for part in ERROR_PARTS},
        colours={name: found for name, values in known.items() if (found := colour_range(values))},
        means={name: (float(values.mean()), float(values.std())) for name, values in known.items()},
        places={name: extents(values) for name, values in fields.places.items() if np.isfinite(values).any()},
        counts={str(code): number for code, number in zip(codes.tolist(), numbers.tolist(), strict=True)},
    )


def valid_share(one: StepSurvey) -> float:
    """Share of the points inside the region that have a value."""
    counts = one["counts"]
    known = sum(counts.get(str(int(code)), 0) for code in (Status.VALID, Status.FILLED))
    return known / max(1, sum(counts.values()))


def extents(places: Array) -> list[Extent]:
    """Least and largest number of each component of places (row, col, component)."""
    low, high = np.nanmin(places, axis=(0, 1)), np.nanmax(places, axis=(0, 1))
    return list(zip(low.tolist(), high.tolist(), strict=True))


def scales_of(steps: Sequence[StepSurvey], first: Sequence[Extent] | None) -> Scales:
    """Scales over all steps. first : extents of the places at the first step"""
    values = {name: LinearScale.over(*extent) for name, extent in _joined(one["values"] for one in steps).items()}
    errors = {
        part: {name: LogScale.over(*extent) for name, extent in _joined(one["errors"][part] for one in steps).items()}
        for part in ERROR_PARTS
    }
    places: dict[str, list[Extent]] = {}
    for one in [*(step["places"] for step in steps), {} if first is None else {"left": list(first)}]:
        for name, found in one.items():
            pairs = zip(places.get(name, found), found, strict=True)
            places[name] = [(min(a[0], b[0]), max(a[1], b[1])) for a, b in pairs]
    return Scales(values, errors, {name: [LinearScale.over(*one) for one in found] for name, found in places.items()})


def _joined(steps: Iterable[Mapping[str, Extent]]) -> dict[str, Extent]:
    """The extents over several steps."""
    found: dict[str, Extent] = {}
    for one in steps:
        for name, (low, high) in one.items():
            least, largest = found.get(name, (low, high))
            found[name] = (min(least, low), max(largest, high))
    return found


def _positive_extents(arrays: Mapping[str, Array]) -> dict[str, Extent]:
    known = {name: values[np.isfinite(values) & (values > 0)] for name, values in arrays.items()}
    return {name: (float(values.min()), float(values.max())) for name, values in known.items() if values.size}
