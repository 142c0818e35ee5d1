"""Figures of products by the names of a result."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from dicflow.discovery import nearest
from dicflow.engine.product import Product
from dicflow.errors import ConfigurationError, NotKeptError
from dicflow.kinds.images import Images
from dicflow.kinds.maps import MapQuantity, Maps, colour_range, joined_range, positions_in
from dicflow.kinds.total import Total
from dicflow.pipeline.places import Places
from dicflow.pipeline.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dicflow.views.colours import Look
    from dicflow.views.windows import MapWindow

__all__ = ["look_of", "maps_of", "plot", "specimen_window"]


def plot(
    result: Result,
    stage: str,
    quantity: str,
    *,
    step: str | int = -1,
    variant: int | str = 0,
    over: Literal["photograph", "specimen"] = "photograph",
    colours: str = "auto",
) -> Figure:
    """One quantity of one step: that of a total over the photograph or the specimen, any other on its grid.

    step : name or number; the last by default. Ignored for a stage that runs once
    variant : of a sweep: "#2" for the second one, or its index, which is 1
    over : the left photograph of the step, or the plane of X and Y; this plane also if the store has no photograph
    colours : a matplotlib colour map; "auto" is the choice of the maps stage, or a diverging one for values of both
        signs and viridis else. The range is that of the maps where they draw the quantity
    Raises ConfigurationError for a quantity that the product does not have and lists those it has.
    """
    result = result.variant(variant)
    product = result.product(stage, step if result.steps(stage) else None)
    if quantity not in product.variables:
        known = ", ".join(product.variables)
        raise ConfigurationError(
            f"no quantity '{quantity}' in {stage}{nearest(quantity, product.variables)}; it has {known}"
        )
    variable = product.variables[quantity]
    if len(variable.dims) != 2:
        fields = ", ".join(name for name, other in product.variables.items() if len(other.dims) == 2) or "none"
        raise ConfigurationError(f"{stage}: {quantity} is not one number per row and column; choose of {fields}")
    name = result.task(stage, step if result.steps(stage) else None, 0).rpartition("/")[2]
    if quantity == "status":
        return _reasons(product, f"{stage} · {name}")
    if product.kind != "total":
        from dicflow.views.maps import picture

        return picture(variable, f"{stage} · {quantity}")
    total, maps = Total.read(product), maps_of(result, stage)
    look = look_of(total, quantity, maps, colours)
    if over == "specimen":
        return _specimen_map(total, look, maps, name)
    from dicflow.views.maps import photo_map

    places = Places(result)
    try:
        photograph = Images.read(result.product(places.photographs, name)).left
    except NotKeptError:
        return _specimen_map(total, look, maps, name)
    return photo_map(product[quantity], places.at_step(total), photograph, look, name)


def _reasons(product: Product, title: str) -> Figure:
    from dicflow.core.status import Status
    from dicflow.views.maps import code_picture

    return code_picture(product.variables["status"], title, {status.value: status.label for status in Status})


def maps_of(result: Result, stage: str, variant: int = 0) -> Maps | None:
    """What the maps of a total share; None if they are not in the store."""
    for name in result.stages_of("maps"):
        if result.has(name, None, variant) and result.source(name, "total", variant) == stage:
            return Maps.read(result.product(name, None, variant))
    return None


def look_of(total: Total, quantity: str, maps: Maps | None, colours: str = "auto") -> Look:
    """The look that the maps give the quantity; else one for the values of this step without outliers."""
    from dicflow.views.colours import look, palette

    if maps is not None and colours == "auto":
        colours = maps.colour_map
    if colours != "auto":
        palette(colours)
    chosen = None if maps is None else maps.quantities.get(quantity)
    if chosen is None:
        seen = joined_range([colour_range(total[quantity])])
        chosen = MapQuantity(total.title(quantity), total.unit_of(quantity), seen)
    return look(quantity, chosen.title, chosen.unit, *chosen.range, colours)


def specimen_window(total: Total, maps: Maps | None) -> MapWindow:
    """The plane of X and Y that a total's maps show: the window of all steps, else one around its points.

    A total without places on the specimen is shown as the image has it.
    """
    from dicflow.views.crops import point_box
    from dicflow.views.windows import MapWindow, map_window, with_margin

    if maps is not None:
        return map_window(maps)
    positions = positions_in(total)
    extent = point_box(total[positions][..., :2]) or (0.0, 0.0, 1.0, 1.0)
    return MapWindow(with_margin(extent), total.unit_of(positions), positions)


def _specimen_map(total: Total, look: Look, maps: Maps | None, title: str) -> Figure:
    from dicflow.views.maps import field_map

    return field_map(total.product, look, specimen_window(total, maps), title)
