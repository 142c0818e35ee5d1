"""What a test is read by over its steps: probes of the pipeline, and the axis of the load."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from typing import Any, TypedDict

from dicflow.explorer.content import Keep
from dicflow.kinds.channels import Channels
from dicflow.kinds.comparison import Comparison
from dicflow.kinds.probes import ProbeTable
from dicflow.kinds.quantities import unit_of
from dicflow.pipeline.result import Result

__all__ = ["Curve", "Loads", "ProbePlace", "loads", "probe_curves", "probe_places"]


class Curve(TypedDict):
    """Readings of a probe.

    name : of the probe
    quantity : what it reads
    title : in words
    unit : of its values
    numbers : of the steps; the first one has 0
    values, errors : readings and their combined standard uncertainties; None if unknown
    """

    name: str
    quantity: str
    title: str
    unit: str
    numbers: list[int]
    values: list[float | None]
    errors: list[float | None]


class ProbePlace(TypedDict):
    """A probe as it lies on the first left photograph.

    name : of the probe
    sort : "point", "line", "area" or "extensometer"
    places : corners or ends [px]
    """

    name: str
    sort: str
    places: list[tuple[float, float]]


class Loads(TypedDict):
    """The load of steps; None if unknown.

    unit : of the load
    steps : of the steps that are shown
    first : of the first photograph
    """

    unit: str
    steps: list[float | None]
    first: float | None


_SORTS = {"points": "point", "lines": "line", "areas": "area", "extensometers": "extensometer"}


def probe_places(result: Result, variant: int = 0) -> list[ProbePlace]:
    """The probes of the pipeline that are given in pixels, computed or not."""
    stages = result.stages_of("probes")
    node: Any = result.node(stages[0], variant) if stages else None
    if node is None or node.unit != "px":
        return []
    return [
        ProbePlace(name=name, sort=sort, places=_corners(places))
        for key, sort in _SORTS.items()
        for name, places in getattr(node, key).items()
    ]


def _corners(places: Sequence[Any]) -> list[tuple[float, float]]:
    """Places of a probe; a point has one, two corners of a rectangle stand for four."""
    if isinstance(places[0], (int, float)):
        if len(places) == 4:
            x0, y0, x1, y1 = places
            return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        return [(float(places[0]), float(places[1]))]
    return [(float(x), float(y)) for x, y in places]


def probe_curves(result: Result, quantity: str, keep: Keep, variant: int = 0) -> list[Curve]:
    """Strain of each extensometer, and a quantity at each point, line and area."""
    for stage in result.stages_of("probes"):
        if result.has(stage, None, variant):
            product, sources = result.product(stage, None, variant), result.digest(stage, None, variant)
            made = keep(["probes", quantity, sources], lambda: _json(ProbeTable.read(product), quantity))  # noqa: B023
            found: list[Curve] = json.loads(made)
            return found
    return []


def loads(result: Result, numbers: Sequence[int], variant: int = 0) -> Loads | None:
    """Loads of steps by their numbers, of the comparison or else of a machine's log; None without either."""
    for stage in result.stages_of("comparison"):
        if result.has(stage, None, variant):
            rows = Comparison.read(result.product(stage, None, variant)).rows
            found = [rows[number].get("load_g") if number < len(rows) else None for number in (0, *numbers)]
            known = any(value is not None for value in found)
            return Loads(unit="g", steps=found[1:], first=found[0]) if known else None
    for stage in result.stages_of("channels"):
        if result.has(stage, None, variant):
            table = Channels.read(result.product(stage, None, variant))
            if table.has_load:
                load = table.of(table.load)
                first, *steps = (_json_number(load.values[number]) for number in (0, *numbers))
                return Loads(unit=load.unit, steps=steps, first=first)
    return None


def _json_number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _json(table: ProbeTable, quantity: str) -> bytes:
    return json.dumps(list(_curves(table, quantity))).encode()


def _curves(table: ProbeTable, quantity: str) -> Iterator[Curve]:
    for index, name in enumerate(table.extensometers):
        yield _curve(table, name, "strain", index, f"strain of the extensometer {name}")
    places = dict.fromkeys(row["probe"] for row in table.rows if row["kind"] != "extensometer")
    for index, name in enumerate(places if quantity in table else ()):
        yield _curve(table, name, quantity, index, f"{quantity} at {name}")


def _curve(table: ProbeTable, name: str, quantity: str, index: int, title: str) -> Curve:
    values, errors = table[quantity][index].tolist(), table[f"u_{quantity}"][index].tolist()
    return Curve(
        name=name,
        quantity=quantity,
        title=title,
        unit=unit_of(quantity, table.unit),
        numbers=list(range(len(values))),
        values=[_known(value) for value in values],
        errors=[_known(value) for value in errors],
    )


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
