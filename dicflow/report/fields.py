"""Section: each quantity over the photographs, step by step.

Photographs and fields are separate small pictures that the page lays upon one another, so each photograph is in the
page once. All that is slow is a piece of its own: one of the whole test, one per step, one per colour bar.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from dicflow.kinds.images import Images
from dicflow.kinds.kind import summary_of
from dicflow.kinds.maps import Maps
from dicflow.kinds.quantities import QUANTITIES, of_field
from dicflow.kinds.total import Total
from dicflow.pipeline import Result
from dicflow.pipeline.places import Places
from dicflow.report.context import Context, Section
from dicflow.report.field_maps import Frame, Scene, as_text, drawn_step, overview
from dicflow.report.rendering import render
from dicflow.views.colours import REASON_COLOURS, Look, look
from dicflow.views.figures import maps_of, specimen_map

__all__ = ["PLACE", "TITLE", "fields"]

PLACE = 20
TITLE = "Fields"

SHOWN = (
    *(name for name, quantity in QUANTITIES.items() if "report" in quantity.uses),
    "sigma_exx",
    "sigma_eyy",
    "znssd",
)
"""Fields shown where a total has them, behind those of the maps."""

_SIZES_PX = (640, 560, 480, 400, 320, 240, 160, 112, 80, 56, 40)
_BUDGET_BYTES = 7.0e6
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
    scene = _scene(result, total, steps[0])
    frame = _frame(context, scene, steps)
    with ThreadPoolExecutor(context.workers) as pool:
        drawn = dict(zip(steps, pool.map(lambda step: _step(context, scene, step, frame), steps), strict=True))
    slid = names if len(names) <= _MOST_STEPS else steps
    peak = _peak(result, total, steps)
    content = {
        "steps": [{"name": step, "maps": drawn.get(step)} for step in slid],
        "start": slid.index(peak),
        "quantities": [_quantity(context, total, look, steps, peak) for look in frame.looks],
        "size": frame.view.size,
        "reference": _reference(context, scene, frame),
        "colours": _reason_colours(),
    }
    bare = not all(maps["photo"] for maps in drawn.values())
    words = _words(result, scene) | {"shown": len(slid), "all": len(names), "bare": bare, "peak": peak}
    body = render("fields.html", content=_as_json(content), **words)
    return Section("fields", TITLE, body, _few_points(drawn))


def _spread(steps: Sequence[str]) -> list[str]:
    """As many steps as a page holds, evenly from the first to the last."""
    most = min(len(steps), _MOST_STEPS)
    return [steps[round(number * (len(steps) - 1) / max(1, most - 1))] for number in range(most)]


def _shown_total(result: Result) -> str | None:
    """The total that the maps are of, else the last one."""
    for stage in result.stages_of("maps"):
        return result.source(stage, "total")
    totals = result.stages_of("total")
    return totals[-1] if totals else None


def _scene(result: Result, total: str, step: str) -> Scene:
    places = Places(result)
    return Scene(total, places, Total.read(result.product(total, step)).follows_material)


def _frame(context: Context, scene: Scene, steps: Sequence[str]) -> Frame:
    """The part of the photograph and the looks, from one reading of all steps."""
    from dicflow.views.overlay import View, view

    result = context.result
    first = Total.read(result.product(scene.total, steps[0]))
    names = _names(result, first)
    sources = ["fields of a test", *names, *_digests(result, scene, steps)]
    found = json.loads(context.pieces.get(sources, lambda: overview(result, scene, steps, names)))
    chosen = {name: quantity for maps in _maps(result) for name, quantity in maps.quantities.items()}
    table = next((maps.colour_map for maps in _maps(result)), "auto")
    looks = []
    for name in names:
        low, high = chosen[name].range if name in chosen else found["ranges"][name]
        choice = table if name in chosen else "auto"
        looks.append(look(name, _title(context, first, name), first.unit_of(name), low, high, choice))
    sources += ["size", json.dumps(looks), result.digest(scene.places.photographs, steps[-1])]
    boxes, size = found["boxes"], found["image_size"]
    frames = [Frame(view(boxes, size, longest), tuple(looks)) for longest in _SIZES_PX]
    fitting = _over_photographs(context, sources, partial(_fitting, result, scene, steps, frames))
    return Frame(View(*json.loads(fitting)), tuple(looks))


def _over_photographs(context: Context, sources: Sequence[str], make: Callable[..., bytes]) -> bytes:
    """A piece with photographs in it, or where these cannot be had that of ``make(bare=True)``."""
    found = context.piece(sources, make)
    return context.pieces.get(["bare", *sources], partial(make, bare=True)) if found is None else found


def _fitting(result: Result, scene: Scene, steps: Sequence[str], frames: Sequence[Frame], bare: bool = False) -> bytes:
    """The first view, of smaller and smaller ones, in which all steps stay within the page's budget.

    The last step stands for all of them; how far a picture shrinks when it is packed depends on its noise.
    """
    for frame in frames:
        if len(steps) * len(drawn_step(result, scene, steps[-1], frame, bare)) < _BUDGET_BYTES:
            break
    return json.dumps(frame.view).encode()


def _maps(result: Result) -> list[Maps]:
    return [Maps.read(result.product(stage)) for stage in result.stages_of("maps") if result.has(stage)]


def _names(result: Result, total: Total) -> list[str]:
    """The quantities of the maps, then the others that are there."""
    chosen = [name for maps in _maps(result) for name in maps.quantities]
    flat = () if total.in_space else ("W",)
    others = [name for name in SHOWN if name in total and name not in flat]
    return list(dict.fromkeys([*chosen, *others]))


def _digests(result: Result, scene: Scene, steps: Sequence[str]) -> list[str]:
    """Digests of all products by which points are placed at these steps."""
    found = [result.digest(scene.total, step) for step in steps]
    if scene.has_grid and scene.places.grid is not None:
        found.append(result.digest(scene.places.grid, 0))
    if scene.places.photographs != scene.places.images:
        found.append(result.digest(result.source(scene.places.images, "rig")))
    return found


def _title(context: Context, total: Total, name: str) -> str:
    """The measure in words, and of a strain the part of the specimen that each value is the mean of."""
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


def _step(context: Context, scene: Scene, step: str, frame: Frame) -> dict[str, Any]:
    """The pictures of one step, as texts that the page shows."""
    result = context.result
    sources = ["fields of a step", *_digests(result, scene, [step]), result.digest(scene.places.photographs, step)]
    sources += [json.dumps(frame.view), json.dumps(frame.looks)]
    drawn = _over_photographs(context, sources, lambda **bare: drawn_step(result, scene, step, frame, **bare))
    found: dict[str, Any] = json.loads(drawn)
    return found


def _reason_colours() -> dict[str, str]:
    from dicflow.core.status import Status

    return {Status(code).label: colour for code, colour in REASON_COLOURS.items()}


def _reference(context: Context, scene: Scene, frame: Frame) -> str | None:
    """The photograph of the first step; None where no map is drawn over it, or where it is not at hand."""
    result = context.result
    if not scene.has_grid:
        return None

    def make() -> bytes:
        from dicflow.views.overlay import photo_jpeg

        return photo_jpeg(Images.read(result.product(scene.places.photographs, 0)).left, frame.view)

    found = context.piece(["photograph", result.digest(scene.places.photographs, 0), json.dumps(frame.view)], make)
    return None if found is None else as_text(found)


def _quantity(context: Context, total: str, look: Look, steps: Sequence[str], peak: str) -> dict[str, Any]:
    """What the page says of a quantity, and where its full maps lie beside the page; else the one of the peak."""

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
        from dicflow.views.maps import png

        return png(specimen_map(Total.read(context.result.product(total, step)), look, maps, step))

    sources = [
        "full map",
        context.result.digest(total, step),
        json.dumps([look, maps and [maps.positions, maps.extent, maps.unit], step]),
    ]
    return as_text(context.pieces.get(sources, make))


def _peak(result: Result, total: str, steps: Sequence[str]) -> str:
    """The step of the largest mean displacement."""

    def size(step: str) -> float:
        summary = summary_of(result.product(total, step))
        return math.hypot(
            *(value for name, value in summary.items() if name.startswith(("mean_U", "mean_V", "mean_W")))
        )

    return max(steps, key=size)


def _words(result: Result, scene: Scene) -> dict[str, Any]:
    """What lies under the maps, and over which step the others lie."""
    plane = result.kind(scene.places.photographs) == "plane"
    photograph = "left photograph, freed of its distortion" if plane else "left photograph"
    return {
        "photograph": photograph,
        "own_grid": not scene.has_grid,
        "first": result.steps(scene.places.photographs)[0],
        "along": scene.has_grid and not result.stages_of("frame"),  # else x is not the photograph's
    }


def _few_points(drawn: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    """A warning where a step has lost most of its points."""
    shares = {step: _share(maps["counts"]) for step, maps in drawn.items()}
    few = {step: share for step, share in shares.items() if share < _FEW}
    if not few:
        return ()
    worst = min(few, key=lambda step: few[step])
    return (f"{len(few)} of {len(drawn)} steps have lost most points; {worst} has values at {few[worst]:.0%}.",)


def _share(counts: Mapping[str, int]) -> float:
    return (counts.get("valid", 0) + counts.get("filled", 0)) / max(1, sum(counts.values()))


def _as_json(content: Any) -> Markup:
    """Data for the page's script; nothing in it ends the element that holds it."""
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"))
    return Markup(text.replace("<", "\\u003c"))
