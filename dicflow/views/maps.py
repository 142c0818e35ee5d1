"""Colour maps of a field over the specimen, in its proportion and in mm."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from io import BytesIO
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import QuadMesh
from matplotlib.colorbar import Colorbar
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from dicflow.engine.product import Product, Variable
from dicflow.kinds.maps import Maps
from dicflow.views.colours import Look
from dicflow.views.colours import look as look_of_range
from dicflow.views.overlay import crop_around, point_box

__all__ = [
    "MapWindow",
    "code_picture",
    "contact_sheet",
    "field_map",
    "field_pngs",
    "gif",
    "map_look",
    "map_window",
    "photo_map",
    "picture",
    "png",
    "with_margin",
]

Array = NDArray[Any]
_HEIGHT_IN, _WIDTH_IN = 5.0, 9.0
_MARGIN_IN, _BAR_IN, _LETTER_IN = 0.1, 0.15, 0.07
_GREY = "0.93"
_MARGIN = 0.04


class MapWindow(NamedTuple):
    """The part of the specimen that a map shows.

    extent : x_min, y_min, x_max, y_max [unit]
    unit : of lengths: mm, or px for a measurement in one camera
    positions : array of the total that says where each point is drawn
    """

    extent: tuple[float, float, float, float]
    unit: str
    positions: str


def map_look(maps: Maps, quantity: str) -> Look:
    """The look of one quantity of a test's maps."""
    chosen = maps.quantities[quantity]
    return look_of_range(quantity, chosen.title, chosen.unit, *chosen.range, maps.colour_map)


def map_window(maps: Maps) -> MapWindow:
    """The window that all maps of a test share."""
    return MapWindow(with_margin(maps.extent), maps.unit, maps.positions)


def with_margin(extent: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """x_min, y_min, x_max, y_max moved outwards by a share of the longer side."""
    x0, y0, x1, y1 = extent
    margin = _MARGIN * max(x1 - x0, y1 - y0)
    return x0 - margin, y0 - margin, x1 + margin, y1 + margin


def field_map(total: Product, look: Look, window: MapWindow, title: str) -> Figure:
    """One step: the field where the specimen is, with axes in its unit and a colour bar."""
    x0, y0, x1, y1 = window.extent
    figure, axes = _figure((x1 - x0) / (y1 - y0))
    mesh = _draw(axes, total, look, window)
    axes.set(xlabel=f"X [{window.unit}]", ylabel=f"Y [{window.unit}]")
    axes.set_title(title, fontsize=9)
    _colour_bar(figure, mesh, look.label)
    return figure


def photo_map(values: Array, places: Array, photo: Array, look: Look, title: str) -> Figure:
    """A field over the part of a photograph in which it lies.

    values : (row, col); a cell with an unknown corner shows the photograph
    places : (row, col, 2) of the points in the photograph [px]
    photo : (row, col) grey levels
    """
    box = point_box(places)
    crop = crop_around([box] if box else [], photo.shape[::-1], max(photo.shape))
    (x0, y0), (width, height) = crop.origin, crop.size
    extent = (x0 - 0.5, y0 - 0.5, x0 + width - 0.5, y0 + height - 0.5)
    figure, axes = _figure(width / height)
    shown = photo[y0 : y0 + height, x0 : x0 + width]
    stride = max(1, max(shown.shape) // 1000)
    edges = (extent[0], extent[2], extent[3], extent[1])
    axes.imshow(shown[::stride, ::stride], cmap="gray", extent=edges, interpolation="antialiased")
    arrays = {look.quantity: Variable(("row", "col"), values), "place": Variable(("row", "col", "component"), places)}
    mesh = _draw(axes, Product("total", arrays), look, MapWindow(extent, "px", "place"))
    axes.set(xlabel="x [px]", ylabel="y [px]")
    axes.set_title(title, fontsize=9)
    _colour_bar(figure, mesh, look.label)
    return figure


def field_pngs(totals: Iterable[Product], look: Look, window: MapWindow, titles: Sequence[str]) -> Iterator[bytes]:
    """:func:`field_map` of many steps as PNG of one size.

    The axes are laid out once, for the longest title, and one step is held at a time.
    """
    figure: Figure | None = None
    for total, title in zip(totals, titles, strict=True):
        if figure is None:
            figure = field_map(total, look, window, max(titles, key=len))
            frame = figure.get_tightbbox().padded(_MARGIN_IN)
        axes = figure.axes[0]
        axes.collections[0].remove()
        _draw(axes, total, look, window)
        axes.set_title(title, fontsize=9)
        yield png(figure, frame)


def contact_sheet(totals: Sequence[Product], names: Sequence[str], look: Look, window: MapWindow, title: str) -> Figure:
    """All steps of a phase side by side with one colour bar."""
    x0, y0, x1, y1 = window.extent
    aspect = (x1 - x0) / (y1 - y0)
    height = min(2.4, 3.84 / aspect)
    pitch = max(height * aspect, _LETTER_IN * max(map(len, names))) + 0.15
    columns = max(1, min(len(totals), math.floor(14.0 / pitch)))
    rows = math.ceil(len(totals) / columns)
    figure = Figure(figsize=(columns * pitch - 0.15, rows * (height + 0.3) - 0.3), dpi=100)
    width_in, height_in = figure.get_size_inches()
    for place, (total, name) in enumerate(zip(totals, names, strict=True)):
        row, column = divmod(place, columns)
        corner = (column * pitch / width_in, 1 - (row * (height + 0.3) + height) / height_in)
        axes = figure.add_axes((*corner, height * aspect / width_in, height / height_in))
        _draw(axes, total, look, window)
        axes.set_title(name, fontsize=8)
        _name_outer(axes, window.unit, left=column == 0, bottom=place + columns >= len(totals))
    figure.text(0.5, 1 + 0.35 / height_in, title, fontsize=10, ha="center")
    shared = ScalarMappable(Normalize(*look.range), matplotlib.colormaps[look.table])
    _colour_bar(figure, shared, look.label).ax.tick_params(labelsize=8)
    return figure


def png(figure: Figure, frame: Bbox | None = None) -> bytes:
    """The figure as a PNG; equal figures give equal bytes.

    frame : the part that is shown [in]; without one all that is drawn, with a narrow margin
    """
    buffer = BytesIO()
    cut: Any = "tight" if frame is None else frame
    figure.savefig(buffer, format="png", metadata={"Software": None}, bbox_inches=cut, pad_inches=_MARGIN_IN)
    return buffer.getvalue()


def gif(frames: Sequence[bytes], seconds: float = 0.5) -> bytes:
    """PNG pictures of one size as an animated GIF that repeats."""
    from PIL import Image

    images = [Image.open(BytesIO(frame)).convert("RGB") for frame in frames]
    palette = images[-1].quantize(256, Image.Quantize.MAXCOVERAGE)  # few pixels of a colour bar count as much as many
    indexed = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    buffer = BytesIO()
    indexed[0].save(buffer, "GIF", save_all=True, append_images=indexed[1:], duration=int(seconds * 1000), loop=0)
    return buffer.getvalue()


def _draw(axes: Axes, total: Product, look: Look, window: MapWindow) -> QuadMesh:
    """The cells whose four corners are measured, each in the mean colour of its corners."""
    positions, values = total[window.positions][..., :2], total[look.quantity]
    cells = (values[:-1, :-1] + values[1:, :-1] + values[:-1, 1:] + values[1:, 1:]) / 4
    known = np.isfinite(positions).all(axis=-1)
    placed = known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
    x, y = np.where(known, positions[..., 0], window.extent[0]), np.where(known, positions[..., 1], window.extent[1])
    masked = np.ma.masked_where(~placed | ~np.isfinite(cells), cells)
    mesh = axes.pcolormesh(x, y, masked, cmap=look.table, vmin=look.range[0], vmax=look.range[1], rasterized=True)
    x0, y0, x1, y1 = window.extent
    axes.set(xlim=(x0, x1), ylim=(y1, y0), aspect="equal", facecolor=_GREY)
    return mesh


def picture(variable: Variable, title: str) -> Figure:
    """One array on the grid of its rows and columns; grey levels in grey, all else in colour with a bar."""
    figure, axes = _figure(variable.values.shape[1] / variable.values.shape[0])
    grey = variable.values.dtype.kind == "u" and variable.units == "grey level"
    image = axes.imshow(variable.values, cmap="gray" if grey else "viridis", interpolation="nearest")
    _name_grid(axes, title)
    unit = "–" if variable.units == "1" else variable.units
    _colour_bar(figure, image, f"{variable.long_name or title} [{unit}]")
    return figure


def code_picture(variable: Variable, title: str, names: Mapping[int, str]) -> Figure:
    """One array of codes on the grid of its rows and columns: each code that occurs has a colour and its name."""
    codes, places = np.unique(variable.values, return_inverse=True)
    figure, axes = _figure(variable.values.shape[1] / variable.values.shape[0])
    colours = matplotlib.colormaps["viridis"].resampled(len(codes))
    levels = places.reshape(variable.values.shape)
    image = axes.imshow(levels, cmap=colours, vmin=-0.5, vmax=len(codes) - 0.5, interpolation="nearest")
    _name_grid(axes, title)
    bar = _colour_bar(figure, image, variable.long_name or title)
    bar.set_ticks(range(len(codes)), labels=[names.get(int(code), str(code)) for code in codes])
    return figure


def _figure(aspect: float) -> tuple[Figure, Axes]:
    """A figure that one map fills whose width is ``aspect`` times its height; labels stand around it."""
    width = min(_HEIGHT_IN * aspect, _WIDTH_IN)
    figure = Figure(figsize=(width, width / aspect), dpi=110)
    return figure, figure.add_axes((0, 0, 1, 1))


def _colour_bar(figure: Figure, shown: ScalarMappable, label: str) -> Colorbar:
    """A colour bar beside what fills a figure, or below where that is too low; its label in lines of its length."""
    width, height = figure.get_size_inches()
    beside = height > 2.3
    place = (1 + 0.15 / width, 0, _BAR_IN / width, 1) if beside else (0, -0.65 / height, 1, _BAR_IN / height)
    bar = figure.colorbar(shown, cax=figure.add_axes(place), orientation="vertical" if beside else "horizontal")
    letters = max(20, int((height if beside else width) / _LETTER_IN))
    bar.set_label(textwrap.fill(label, letters), fontsize=9)
    return bar


def _name_outer(axes: Axes, unit: str, left: bool, bottom: bool) -> None:
    """Label the axes at the left edge of a sheet, and those at the end of a column."""
    axes.tick_params(labelsize=7, labelleft=left, labelbottom=bottom)
    axes.set_xlabel(f"X [{unit}]" if bottom else "", fontsize=8)
    axes.set_ylabel(f"Y [{unit}]" if left else "", fontsize=8)


def _name_grid(axes: Axes, title: str) -> None:
    axes.set(xlabel="column", ylabel="row", facecolor=_GREY)
    axes.set_title(title, fontsize=9)
