"""Colour maps of a field over the specimen, in its proportion and in mm."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from io import BytesIO
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import QuadMesh
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from dicflow.engine.product import Product, Variable

__all__ = ["Style", "contact_sheet", "field_map", "field_pngs", "gif", "picture", "png", "style"]

_HEIGHT_IN = 5.0
_GREY = "0.93"


class Style(NamedTuple):
    """What all maps of one quantity share.

    quantity : name of the array drawn
    title : the measure's name
    unit : of its values; "1" for a strain
    range : colours run between these two values
    extent : (x_min, y_min, x_max, y_max) of the window [length_unit]
    length_unit : mm, or px for a measurement in one camera
    positions : array that holds where each point is drawn
    colour_map : name of a matplotlib colour map
    """

    quantity: str
    title: str
    unit: str
    range: tuple[float, float]
    extent: tuple[float, float, float, float]
    length_unit: str
    positions: str
    colour_map: str

    @property
    def label(self) -> str:
        """The measure with its unit, as on a colour bar."""
        return f"{self.title} [{'–' if self.unit == '1' else self.unit}]"


def style(maps: Mapping[str, Any], quantity: str) -> Style:
    """The style of one quantity from the attributes of a product of kind "maps"."""
    chosen = maps["quantities"][quantity]
    low, high = chosen["range"]
    x0, y0, x1, y1 = maps["extent"]
    margin = 0.04 * max(x1 - x0, y1 - y0)
    return Style(
        quantity,
        chosen["title"],
        chosen["unit"],
        (low, high),
        (x0 - margin, y0 - margin, x1 + margin, y1 + margin),
        maps["unit"],
        maps["positions"],
        maps["colour_map"],
    )


def field_map(total: Product, look: Style, title: str) -> Figure:
    """One step: the field where the specimen is, with axes in its unit and a colour bar."""
    x0, y0, x1, y1 = look.extent
    aspect = (x1 - x0) / (y1 - y0)
    width = min(max(_HEIGHT_IN * aspect, 1.6), 11.0)
    height = min(_HEIGHT_IN, max(width / aspect, 1.6))
    figure = Figure(figsize=(width + 2.0, height + 1.0), dpi=110, layout="constrained")
    axes = figure.add_subplot()
    mesh = _draw(axes, total, look)
    axes.set(xlabel=f"X [{look.length_unit}]", ylabel=f"Y [{look.length_unit}]")
    axes.set_title(title, fontsize=9)
    figure.colorbar(mesh, ax=axes, label=look.label)
    return figure


def field_pngs(totals: Iterable[Product], look: Style, titles: Iterable[str]) -> Iterator[bytes]:
    """:func:`field_map` of many steps as PNG; the axes are laid out once, and one step is held at a time."""
    figure: Figure | None = None
    for total, title in zip(totals, titles, strict=True):
        if figure is None:
            figure = field_map(total, look, title)
            figure.draw_without_rendering()
            figure.set_layout_engine("none")
        else:
            axes = figure.axes[0]
            axes.collections[0].remove()
            _draw(axes, total, look)
            axes.set_title(title, fontsize=9)
        yield png(figure)


def contact_sheet(totals: Sequence[Product], names: Sequence[str], look: Style, title: str) -> Figure:
    """All steps of a phase side by side with one colour bar; each is read, drawn and let go."""
    x0, y0, x1, y1 = look.extent
    aspect = (x1 - x0) / (y1 - y0)
    tall = 2.4 * min(1.0, 1.6 / aspect)
    tile = (0.4 + max(tall * aspect, 0.7), 0.4 + tall)
    columns = max(1, min(len(totals), math.floor(14.0 / tile[0])))
    rows = math.ceil(len(totals) / columns)
    figure = Figure(figsize=(columns * tile[0] + 2.2, rows * tile[1] + 1.0), dpi=100, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axes in grid.flat[len(totals) :]:
        axes.set_axis_off()
    for axes, total, name in zip(grid.flat, totals, names, strict=False):
        _draw(axes, total, look)
        axes.set_title(name, fontsize=8)
        axes.tick_params(labelsize=7)
    figure.supxlabel(f"X [{look.length_unit}]", fontsize=9)
    figure.supylabel(f"Y [{look.length_unit}]", fontsize=9)
    figure.suptitle(title, fontsize=11)
    shared = ScalarMappable(Normalize(*look.range), matplotlib.colormaps[look.colour_map])
    figure.colorbar(shared, ax=grid, label=look.label, fraction=0.05)
    return figure


def png(figure: Figure) -> bytes:
    """The figure as a PNG; equal figures give equal bytes."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def gif(frames: Sequence[bytes], seconds: float = 0.5) -> bytes:
    """PNG pictures of one size as an animated GIF that repeats."""
    from PIL import Image

    images = [Image.open(BytesIO(frame)).convert("RGB") for frame in frames]
    palette = images[-1].quantize(256)
    indexed = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    buffer = BytesIO()
    indexed[0].save(buffer, "GIF", save_all=True, append_images=indexed[1:], duration=int(seconds * 1000), loop=0)
    return buffer.getvalue()


def _draw(axes: Axes, total: Product, look: Style) -> QuadMesh:
    """The cells whose four corners are measured, each in the mean colour of its corners."""
    positions, values = total[look.positions][..., :2], total[look.quantity]
    cells = (values[:-1, :-1] + values[1:, :-1] + values[:-1, 1:] + values[1:, 1:]) / 4
    known = np.isfinite(positions).all(axis=-1)
    placed = known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
    x, y = np.where(known, positions[..., 0], look.extent[0]), np.where(known, positions[..., 1], look.extent[1])
    masked = np.ma.masked_where(~placed | ~np.isfinite(cells), cells)
    mesh = axes.pcolormesh(x, y, masked, cmap=look.colour_map, vmin=look.range[0], vmax=look.range[1], rasterized=True)
    x0, y0, x1, y1 = look.extent
    axes.set(xlim=(x0, x1), ylim=(y1, y0), aspect="equal", facecolor=_GREY)
    return mesh


def picture(variable: Variable, title: str) -> Figure:
    """One array on the grid of its rows and columns; grey levels in grey, all else in colour with a bar."""
    rows, cols = variable.values.shape
    width = min(max(6.0 * cols / rows, 2.0), 10.0)
    figure = Figure(figsize=(width + 1.5, min(6.0, width * rows / cols) + 0.8), dpi=110, layout="constrained")
    axes = figure.add_subplot()
    grey = variable.values.dtype.kind == "u" and variable.units == "grey level"
    image = axes.imshow(variable.values, cmap="gray" if grey else "viridis", interpolation="nearest")
    axes.set(xlabel="column", ylabel="row")
    axes.set_title(title, fontsize=9)
    unit = "–" if variable.units == "1" else variable.units
    figure.colorbar(image, ax=axes, label=f"{variable.long_name or title} [{unit}]")
    return figure
