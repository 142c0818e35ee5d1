"""Figures of a field over the specimen or a photograph, and of any array, for matplotlib."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from io import BytesIO
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import QuadMesh
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dicflow.engine.product import Product, Variable
from dicflow.views.colours import Look
from dicflow.views.crops import crop_around, point_box
from dicflow.views.levels import cell_means
from dicflow.views.windows import MapWindow

__all__ = ["code_picture", "field_map", "photo_map", "picture", "png"]

Array = NDArray[Any]
_HEIGHT_IN, _WIDTH_IN = 5.0, 9.0
_MARGIN_IN, _BAR_IN, _LETTER_IN = 0.1, 0.15, 0.07
_GREY = "0.93"


def field_map(total: Product, look: Look, window: MapWindow, title: str) -> Figure:
    """One step: the field where the specimen is, with axes in its unit and a colour bar."""
    figure, axes = _figure(window.aspect)
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


def png(figure: Figure) -> bytes:
    """All that a figure shows, with a narrow margin, as a PNG; equal figures give equal bytes."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None}, bbox_inches="tight", pad_inches=_MARGIN_IN)
    return buffer.getvalue()


def _draw(axes: Axes, total: Product, look: Look, window: MapWindow) -> QuadMesh:
    """The cells whose four corners are measured, each in the mean colour of its corners."""
    positions, values = total[window.positions][..., :2], total[look.quantity]
    cells = cell_means(values)
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


def _name_grid(axes: Axes, title: str) -> None:
    axes.set(xlabel="column", ylabel="row", facecolor=_GREY)
    axes.set_title(title, fontsize=9)
