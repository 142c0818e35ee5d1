"""Figures from datasets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

from dicflow.discovery import nearest
from dicflow.engine.product import Product
from dicflow.errors import ConfigurationError, NotKeptError
from dicflow.pipeline.result import Result

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from dicflow.views.colours import Look

__all__ = ["look_of", "maps_of", "plot", "specimen_map"]

_LEFT_OUT_PERCENT, _MARGIN = 0.5, 0.04


def plot(
    result: Result,
    stage: str,
    quantity: str,
    *,
    step: str | int = -1,
    variant: int = 0,
    over: Literal["photograph", "specimen"] = "photograph",
    colours: str = "auto",
) -> Figure:
    """One quantity of one step: that of a total over the photograph or the specimen, any other on its grid.

    step : name or number; the last by default. Not looked at for a stage that runs once
    over : the left photograph of the step, or the plane of X and Y; this plane also where the photograph is not at hand
    colours : a matplotlib colour map; "auto" is the choice of the maps stage, or a diverging one for values of both
        signs and viridis else. The range is that of the maps where they draw the quantity
    Raises ConfigurationError for a quantity that the product does not have and lists those it has.
    """
    product = result.product(stage, step if result.steps(stage) else None, variant)
    if quantity not in product.variables:
        known = ", ".join(product.variables)
        raise ConfigurationError(
            f"no quantity '{quantity}' in {stage}{nearest(quantity, product.variables)}; it has {known}"
        )
    variable = product.variables[quantity]
    if len(variable.dims) != 2:
        fields = ", ".join(name for name, other in product.variables.items() if len(other.dims) == 2) or "none"
        raise ConfigurationError(f"{stage}: {quantity} is not one number per row and column; choose of {fields}")
    name = result.task(stage, step if result.steps(stage) else None, variant).rpartition("/")[2]
    if quantity == "status":
        return _reasons(product, f"{stage} · {name}")
    if product.kind != "total":
        from dicflow.views.maps import picture

        return picture(variable, f"{stage} · {quantity}")
    maps = maps_of(result, stage, variant)
    look = look_of(product, quantity, maps, colours)
    if over == "specimen":
        return specimen_map(product, look, maps, name)
    from dicflow.views.maps import photo_map

    try:
        places, photo = _photograph(result, product, name, variant)
    except NotKeptError:
        return specimen_map(product, look, maps, name)
    return photo_map(product[quantity], places, photo, look, name)


def _reasons(product: Product, title: str) -> Figure:
    from dicflow.core.status import Status
    from dicflow.views.maps import code_picture

    return code_picture(product.variables["status"], title, {status.value: status.label for status in Status})


def maps_of(result: Result, stage: str, variant: int = 0) -> Mapping[str, Any] | None:
    """What the maps of a total share: attributes of a product of kind "maps". None where they are not in the store."""
    for name in result.stages_of("maps"):
        if result.has(name, None, variant) and result.source(name, "total", variant) == stage:
            return result.product(name, None, variant).attrs
    return None


def look_of(total: Product, quantity: str, maps: Mapping[str, Any] | None, colours: str = "auto") -> Look:
    """As the maps show the quantity; else by the values of this step but for a few."""
    import numpy as np

    from dicflow.views.colours import look, palette

    if maps is not None and colours == "auto":
        colours = maps["colour_map"]
    if colours != "auto":
        palette(colours)
    if maps is not None and quantity in maps["quantities"]:
        chosen = maps["quantities"][quantity]
        low, high = chosen["range"]
        return look(quantity, chosen["title"], chosen["unit"], low, high, colours)
    values = total[quantity][np.isfinite(total[quantity])]
    low, high = np.percentile(values, [_LEFT_OUT_PERCENT, 100 - _LEFT_OUT_PERCENT]) if values.size else (0.0, 1.0)
    if high - low < 1e-12:
        low, high = low - 0.5e-6, high + 0.5e-6
    variable = total.variables[quantity]
    title = total.attrs.get("measures", {}).get(quantity) or variable.long_name or quantity
    return look(quantity, title, variable.units, float(low), float(high), colours)


def specimen_map(total: Product, look: Look, maps: Mapping[str, Any] | None, title: str) -> Figure:
    """One quantity of a total over the plane of X and Y, in the window of its maps where there are any."""
    from dicflow.views.maps import Style, field_map
    from dicflow.views.overlay import point_box

    positions = "xyz" if maps is None else maps["positions"]
    whole = maps["extent"] if maps is not None else point_box(total[positions][..., :2]) or (0.0, 0.0, 1.0, 1.0)
    margin = _MARGIN * max(whole[2] - whole[0], whole[3] - whole[1])
    extent = (whole[0] - margin, whole[1] - margin, whole[2] + margin, whole[3] + margin)
    style = Style(look.quantity, look.title, look.unit, look.range, extent, total.attrs["unit"], positions, look.table)
    return field_map(total, style, title)


def _photograph(result: Result, total: Product, step: str, variant: int) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Places of a total's points in the left photograph (row, col, 2) [px], and the photograph."""
    import numpy as np

    places = np.asarray(total["xy"], dtype=float)
    images = result.source(result.stages_of("region")[0], "images", variant)
    if result.kind(images) != "rectified":
        return places, result.product(images, step, variant)["left"]
    from dicflow.core.cameras.rectification import rectification, rectified_to_raw
    from dicflow.kinds.rig import rig_from_json

    rig = rig_from_json(result.product(result.source(images, "rig", variant), None, variant).attrs["rig"])
    rectified = rectification(rig)
    raw = rectified_to_raw(places, rig.left, rectified.rotation_left, rectified.matrix_left)
    return raw, result.product(result.source(images, "images", variant), step, variant)["left"]


Result.drawing = plot
