"""Section: each quantity over the photographs, step by step.

Photographs and fields are separate small pictures that the page lays upon one another, so each photograph is in the
page once.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from dicflow.kinds.kind import summary_of
from dicflow.kinds.maps import Maps
from dicflow.kinds.quantities import DISPLACEMENTS, REPORTED, of_field
from dicflow.kinds.total import Total
from dicflow.pipeline import Result
from dicflow.pipeline.places import Places
from dicflow.report.context import Context, Section
from dicflow.report.rendering import render
from dicflow.views.colours import REASON_COLOURS, Look, look
from dicflow.views.figures import maps_of, specimen_window
from dicflow.views.step_maps import StepMaps, as_text

__all__ = ["PLACE", "TITLE", "fields"]

PLACE = 20
TITLE = "Fields"

_MOST_STEPS = 40
_FEW = 0.5


def fields(context: Context) -> Section | None:
    """The section, None for a pipeline without totals."""
    result = context.result
    total = _shown_total(result)
    if total is None:
        return None
    names = result.steps(total)
    steps = _spread([step for step in names if result.has(total, step)])
    if not steps:
        return Section("fields", TITLE, Markup("<p>No step has displacements yet.</p>"))
    first = Total.read(result.product(total, steps[0]))
    maps = StepMaps(result, total, Places(result), first.follows_material, context.pieces.get)
    shown = _names(result, first)
    overview = maps.overview(steps, shown)
    looks = _looks(context, first, shown, overview.ranges)
    crop = maps.crop(overview, steps, looks)
    with ThreadPoolExecutor(context.workers) as pool:
        drawn = dict(zip(steps, pool.map(lambda step: maps.at_step(step, crop, looks), steps), strict=True))
    listed = names if len(names) <= _MOST_STEPS else steps
    peak = _peak(result, total, steps)
    content = {
        "steps": [{"name": step, "maps": drawn.get(step)} for step in listed],
        "start": listed.index(peak),
        "quantities": [_quantity(context, total, look, steps, peak) for look in looks],
        "size": crop.size,
        "reference": maps.first_photograph(crop),
        "colours": _reason_colours(),
    }
    bare = not all(pictures["photo"] for pictures in drawn.values())
    words = _words(maps) | {"shown": len(listed), "all": len(names), "bare": bare, "peak": peak}
    body = render("fields.html", content=_as_json(content), **words)
    return Section("fields", TITLE, body, _few_points(drawn))


def _spread(steps: Sequence[str]) -> list[str]:
    """At most as many steps as a page holds, evenly from the first to the last."""
    most = min(len(steps), _MOST_STEPS)
    return [steps[round(number * (len(steps) - 1) / max(1, most - 1))] for number in range(most)]


def _shown_total(result: Result) -> str | None:
    """The total that the maps stage draws, else the last one."""
    for stage in result.stages_of("maps"):
        return result.source(stage, "total")
    totals = result.stages_of("total")
    return totals[-1] if totals else None


def _looks(
    context: Context, first: Total, names: Sequence[str], ranges: Mapping[str, tuple[float, float]]
) -> list[Look]:
    """The look of each quantity: its range and colour map are those of the maps where they draw it."""
    maps = _maps(context.result)
    mapped = {name: quantity.range for one in maps for name, quantity in one.quantities.items()}
    looks = []
    for name in names:
        choice = maps[0].colour_map if name in mapped else "auto"
        low, high = mapped.get(name, ranges[name])
        looks.append(look(name, _title(context, first, name), first.unit_of(name), low, high, choice))
    return looks


def _maps(result: Result) -> list[Maps]:
    return [Maps.read(result.product(stage)) for stage in result.stages_of("maps") if result.has(stage)]


def _names(result: Result, total: Total) -> list[str]:
    """The quantities of the maps, then the others that the total has."""
    chosen = [name for maps in _maps(result) for name in maps.quantities]
    flat = () if total.in_space else ("W",)
    others = [name for name in REPORTED if name in total and name not in flat]
    return list(dict.fromkeys([*chosen, *others]))


def _title(context: Context, total: Total, name: str) -> str:
    """The measure in words, and of a strain the part of the specimen over which it is averaged."""
    quantity = of_field(name)
    if total.gauge is not None or quantity is None or quantity.is_displacement:
        return total.caption(name)
    return total.title(name) + _window(context)


def _window(context: Context) -> str:
    """The window of the thesis form's strains, which has no virtual gauge of known size."""
    for stage in context.result.stages_of("strain_increment"):
        node: Any = context.result.graph.stages[context.pipeline.instances[0][stage]].node
        if window := getattr(node, "window", None):
            return f", window {' × '.join(f'{side:g}' for side in window)} px"
    return ""


def _reason_colours() -> dict[str, str]:
    from dicflow.core.status import Status

    return {Status(code).label: colour for code, colour in REASON_COLOURS.items()}


def _quantity(context: Context, total: str, look: Look, steps: Sequence[str], peak: str) -> dict[str, Any]:
    """A quantity's label, colour bar and full maps: files beside the page, else the one of the peak as text."""

    def make() -> bytes:
        from dicflow.views.overlay import colour_bar_svg

        return colour_bar_svg(look).encode()

    bar = context.pieces.get(["colour bar", json.dumps(look)], make).decode()
    prefix = "" if len(context.result.values) == 1 else "variant_1/"
    files = {
        step: f"{prefix}{stage}/{look.quantity}/{step}.png"
        for stage in context.result.stages_of("maps")
        for step in steps
    }
    there = {step: quote(file) for step, file in files.items() if (context.folder / file).is_file()}
    full = None if there else _full_map(context, total, look, peak)
    return {"name": look.quantity, "label": look.label, "bar": bar, "files": there, "full": full}


def _full_map(context: Context, total: str, look: Look, step: str) -> str:
    """A quantity at one step over the specimen, with axes and colour bar."""
    maps = maps_of(context.result, total)

    def make() -> bytes:
        from dicflow.views.map_pictures import map_png

        shown = Total.read(context.result.product(total, step))
        return map_png(shown.product, look, specimen_window(shown, maps), step)

    arrays = context.result.arrays(total, step)
    shown = [arrays[name].digest for name in ("xyz" if maps is None else maps.positions, look.quantity)]
    sources = ["full map", *shown, json.dumps([look, maps and [maps.positions, maps.extent, maps.unit], step])]
    return as_text(context.pieces.get(sources, make))


def _peak(result: Result, total: str, steps: Sequence[str]) -> str:
    """The step of the largest mean displacement."""
    means = tuple(f"mean_{name}" for name in DISPLACEMENTS)

    def size(step: str) -> float:
        summary = summary_of(result.product(total, step))
        return math.hypot(*(value for name, value in summary.items() if name.startswith(means)))

    return max(steps, key=size)


def _words(maps: StepMaps) -> dict[str, Any]:
    """Values of the template that describe the photographs under the maps."""
    result, photographs = maps.result, maps.places.photographs
    plane = result.kind(photographs) == "plane"
    return {
        "photograph": "left photograph, freed of its distortion" if plane else "left photograph",
        "own_grid": not maps.has_grid,
        "first": result.steps(photographs)[0],
        "along": maps.has_grid and not result.stages_of("frame"),  # else x is not the photograph's
    }


def _few_points(drawn: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    """A warning if a step has lost most of its points."""
    shares = {step: _share(maps["counts"]) for step, maps in drawn.items()}
    few = {step: share for step, share in shares.items() if share < _FEW}
    if not few:
        return ()
    worst = min(few, key=lambda step: few[step])
    return (f"{len(few)} of {len(drawn)} steps have lost most points; {worst} has values at {few[worst]:.0%}.",)


def _share(counts: Mapping[str, int]) -> float:
    return (counts.get("valid", 0) + counts.get("filled", 0)) / max(1, sum(counts.values()))


def _as_json(content: Any) -> Markup:
    """Data for the page's script, escaped so that no text can close the element around it."""
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c"))
