"""Pictures of products, and movies over their steps, as files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from dicflow.discovery import nearest
from dicflow.engine.product import Product, Variable
from dicflow.errors import ConfigurationError
from dicflow.io.exports.items import Item, place
from dicflow.kinds.maps import Maps
from dicflow.kinds.total import Total
from dicflow.pipeline.result import Result
from dicflow.views.figures import look_of, maps_of, plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dicflow.views.colours import Look
    from dicflow.views.windows import MapWindow

__all__ = [
    "PICTURES",
    "Drawn",
    "Picture",
    "check_quantities",
    "write_movies",
    "write_pictures",
    "write_surfaces",
]


class Drawn(NamedTuple):
    """What is to be drawn.

    steps : of each stage
    quantities : names of arrays; without any all that can be drawn
    """

    result: Result
    steps: Mapping[str, Sequence[str | None]]
    quantities: tuple[str, ...]
    variant: int


def check_quantities(stage: str, product: Product, quantities: Sequence[str]) -> None:
    """Raise ConfigurationError, which lists the arrays of the product, for an array that it does not have."""
    for name in quantities:
        if name not in product:
            known = ", ".join(product.variables) or "no array"
            raise ConfigurationError(
                f"no quantity '{name}' in {stage}{nearest(name, product.variables)}; it has {known}"
            )


def write_pictures(drawn: Drawn, form: str, folder: Path, whole: bool) -> None:
    """One picture per product and array on a grid.

    whole : of a whole test, where no quantity is named, draw those of its maps alone
    Raises ConfigurationError for a product that has nothing to draw.
    """
    from dicflow.views.plots import saved

    for item, quantity in _fields(drawn, whole):
        figure = _figure(drawn, item, quantity)
        place(folder, f"{item.stem}_{quantity}.{form}").write_bytes(saved(figure, form))


def write_surfaces(drawn: Drawn, form: str, folder: Path, whole: bool) -> None:
    """The surface in space, coloured by a field: one picture in PNG per total and array on its grid.

    form, whole : as for :func:`write_pictures`
    Raises ConfigurationError if pyvista is not installed, and for a measurement with one camera.
    """
    from dicflow.views.solid import surface

    for item, quantity in _fields(drawn, whole):
        total = Total.read(item.product)
        if not total.in_space:
            raise ConfigurationError(
                f"{item.stem}: a measurement with one camera has no surface in space; export it as png"
            )
        look = look_of(total, quantity, maps_of(drawn.result, item.stage, drawn.variant))
        surface(item.product, look, place(folder, f"{item.stem}_{quantity}_surface.png"))


def _fields(drawn: Drawn, whole: bool) -> Iterator[tuple[Item, str]]:
    """Every product with each of its selected arrays."""
    for stage, steps in drawn.steps.items():
        usual = _usual(drawn, stage) if whole else ()
        for step in steps:
            product = drawn.result.product(stage, step, drawn.variant)
            check_quantities(stage, product, drawn.quantities)
            item = Item(stage, step, product)
            yield from ((item, quantity) for quantity in _drawable(item, drawn.quantities, usual))


def _drawable(item: Item, named: Sequence[str], usual: Sequence[str]) -> Sequence[str]:
    """The named arrays; without names the usual ones, or all, as far as they can be drawn."""
    variables = item.product.variables
    fields = [name for name in named or usual or variables if name in variables and _is_field(variables[name])]
    unsuited = [name for name in named if name not in fields]
    if unsuited or not fields:
        raise ConfigurationError(
            f"{item.stem}: {', '.join(unsuited) or f'a product of kind {item.product.kind}'} has no array to draw, a "
            "number for each place of a grid; export it as csv or npz"
        )
    return fields


def _is_field(variable: Variable) -> bool:
    import numpy as np

    return len(variable.dims) == 2 and variable.dims == ("row", "col") and bool(np.isfinite(variable.values).any())


def _figure(drawn: Drawn, item: Item, quantity: str) -> Figure:
    from dicflow.core.status import Status
    from dicflow.views.maps import code_picture

    if quantity == "status":
        reasons = {status.value: status.label for status in Status}
        return code_picture(item.product.variables[quantity], f"{item.stem} · {quantity}", reasons)
    step = -1 if item.step is None else item.step
    return plot(drawn.result, item.stage, quantity, step=step, variant=drawn.variant)


def write_movies(drawn: Drawn, form: str, folder: Path, whole: bool) -> None:
    """One movie per total and quantity over its steps; without quantities those of the maps, for one total and for all.

    Raises ConfigurationError for a quantity that maps do not draw.
    """
    from dicflow.views.levels import gif_file
    from dicflow.views.map_pictures import map_sheet, maps_of_steps
    from dicflow.views.video import movie

    for stage, steps in drawn.steps.items():
        totals = [drawn.result.product(stage, step, drawn.variant) for step in steps]
        check_quantities(stage, totals[0], drawn.quantities)
        titles = [str(step) for step in steps]
        for quantity in drawn.quantities or _usual(drawn, stage):
            path = place(folder, f"{Item(stage, quantity, totals[0]).stem}.{form}")
            look, window = _style(drawn, stage, quantity, totals)
            page = map_sheet(look, window, titles)
            frames = maps_of_steps(page, totals, look, window, titles)
            if form == "gif":
                path.write_bytes(gif_file(frames, page.colours))
            else:
                movie((page.colours[frame] for frame in frames), path)


def _usual(drawn: Drawn, stage: str) -> tuple[str, ...]:
    """Quantities of the maps of a total, or those that maps have by default."""
    from dicflow.stages.maps import Maps as MapsStage

    maps = maps_of(drawn.result, stage, drawn.variant)
    return MapsStage().quantities if maps is None else tuple(maps.quantities)


def _style(drawn: Drawn, stage: str, quantity: str, totals: Sequence[Product]) -> tuple[Look, MapWindow]:
    """Look and window that all steps share."""
    from dicflow.engine.looks import with_looks
    from dicflow.stages.maps import Maps as MapsStage
    from dicflow.views.windows import map_look, map_window

    maps = maps_of(drawn.result, stage, drawn.variant)
    if maps is None or quantity not in maps.quantities:
        try:
            node = MapsStage(quantities=(quantity,))
            maps = Maps.read(node.run(**with_looks(node, {"total": totals})))
        except ValueError as error:
            raise ConfigurationError(
                f"{stage}: no movie of {quantity}: a movie shows a displacement or strain"
            ) from error
    return map_look(maps, quantity), map_window(maps)


class Picture(NamedTuple):
    """A format of pictures.

    description : what it is, in a few words
    write : makes the files from what is to be drawn, the format's name, the folder, and whether it is a whole test
    kinds : of products that it can show; None for any with an array on a grid
    moves : whether one file shows all steps
    """

    description: str
    write: Callable[[Drawn, str, Path, bool], None]
    kinds: tuple[str, ...] | None = None
    moves: bool = False


PICTURES = {
    "png": Picture("a picture", write_pictures),
    "pdf": Picture("a picture", write_pictures),
    "svg": Picture("a picture", write_pictures),
    "surface": Picture("a picture in space (needs dicflow[solid])", write_surfaces, ("total",)),
    "gif": Picture("a movie", write_movies, ("total",), moves=True),
    "mp4": Picture("a movie", write_movies, ("total",), moves=True),
    "webm": Picture("a movie", write_movies, ("total",), moves=True),
}
"""The formats of pictures and movies by name."""
