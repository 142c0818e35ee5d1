"""The main fields of a test as pictures and numbers, for paper, where no explorer can be asked."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping
from typing import NamedTuple

from dicflow.explorer.manifest import Manifest, QuantityEntry
from dicflow.kinds.kind import summary_of
from dicflow.kinds.maps import positions_in
from dicflow.kinds.quantities import BASIC
from dicflow.kinds.total import Total, named_with_unit
from dicflow.report.context import Context
from dicflow.report.words import number

__all__ = ["MainFields", "main_fields"]


class MainFields(NamedTuple):
    """Fields of the step that the page shows first.

    pictures : title and address of each
    rows : symbol with unit, mean, spread, median u
    """

    step: str
    pictures: list[tuple[str, str]]
    rows: list[list[str]]


def main_fields(context: Context, manifest: Manifest) -> MainFields | None:
    """The displacements and strains at the main step; None for a shape, or where the product is missing."""
    stage, step = manifest["stage"], manifest["steps"][manifest["main"][1]]["name"]
    if manifest["form"] != "deformation" or not context.result.has(stage, step):
        return None
    shown = {one["name"]: one for one in manifest["quantities"] if one["name"] in BASIC}
    if not shown:
        return None
    place = manifest["main"][1]
    summary = summary_of(context.result.product(stage, step))
    rows = [_row(one, place, summary, manifest["unit"]) for one in shown.values()]
    return MainFields(step, _pictures(context, stage, step, shown), rows)


def _row(one: QuantityEntry, place: int, summary: Mapping[str, float], length: str) -> list[str]:
    unit = "–" if one["unit"] == "1" else one["unit"]
    mean, spread = one["means"][place] or (None, None)
    u = summary.get(f"u_{named_with_unit(one['name'], length)}")
    return [f"{one['symbol']} [{unit}]", *(number(value, 3) for value in (mean, spread, u))]


def _pictures(context: Context, stage: str, step: str, shown: Mapping[str, QuantityEntry]) -> list[tuple[str, str]]:
    """The maps, drawn once for the same arrays in the same colours."""
    arrays = context.result.arrays(stage, step)
    digests = [arrays[name].digest for name in (*shown, positions_in(arrays))]
    looks = [(name, one["title"], one["unit"], one["range"]) for name, one in shown.items()]
    kept = context.piece(
        ["main fields", step, json.dumps(looks), *digests],
        lambda: json.dumps(_drawn(context, stage, step, shown)).encode(),
    )
    found = {} if kept is None else json.loads(kept)
    return [(shown[name]["title"], f"data:image/png;base64,{content}") for name, content in found.items()]


def _drawn(context: Context, stage: str, step: str, shown: Mapping[str, QuantityEntry]) -> dict[str, str]:
    """Quantity → PNG as base64."""
    from dicflow.views.figures import look_of, maps_of, specimen_window
    from dicflow.views.levels import field_levels
    from dicflow.views.map_pictures import contact_sheet, map_cells, map_tile

    total, maps = Total.read(context.result.product(stage, step)), maps_of(context.result, stage)
    window = specimen_window(total, maps)
    looks = {name: look_of(total, name, maps) for name in shown}
    cells = map_cells(total.product, window, map_tile(window))
    maps_alone = {name: field_levels(total[name], cells, look) for name, look in looks.items()}
    return {
        name: b64encode(contact_sheet([levels], [""], looks[name], window, shown[name]["symbol"])).decode()
        for name, levels in maps_alone.items()
    }
