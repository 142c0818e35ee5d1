"""Charts of a measurement: figures from data alone, and figures as files."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from io import BytesIO, StringIO
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

__all__ = [
    "profile_figure",
    "saved",
    "steps_figure",
    "svg",
]

Array = NDArray[Any]

_COLOURS = ("#3b82b5", "#d95f02", "#4d9a3a", "#a05cb0", "#b08d20", "#7a7a7a")
_INK = "#010203"
"""Placeholder for the colour of the surrounding text; the SVG replaces it by ``currentColor``."""
_STYLE: dict[Any, Any] = {
    "svg.hashsalt": "dicflow",
    "svg.fonttype": "none",
    "font.size": 9,
    **{f"{part}.color": _INK for part in ("text", "xtick", "ytick")},
    "axes.edgecolor": _INK,
    "axes.labelcolor": _INK,
    "axes.facecolor": "none",
    "legend.frameon": False,
}
_UNDATED: dict[str, dict[str, Any]] = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
_FORMLESS: dict[Any, Any] = {"Date": None, "Creator": None, "Format": None, "Type": None}
_MANY_STEPS = 8


def saved(figure: Figure, form: str) -> bytes:
    """A figure as "png", "pdf" or "svg" on white; equal figures give equal bytes."""
    buffer = BytesIO()
    with _style():
        figure.savefig(
            buffer, format=form, metadata=_UNDATED[form], bbox_inches="tight", pad_inches=0.1, facecolor="white"
        )
    return buffer.getvalue()


def svg(figure: Figure) -> str:
    """A figure as an element of an HTML page: transparent, in the page's text colour, with ids of its own."""
    written = StringIO()
    with _style():
        figure.savefig(written, format="svg", metadata=_FORMLESS, transparent=True)
    text = written.getvalue()
    own = hashlib.sha256(text.encode()).hexdigest()[:8]
    text = text[text.index("<svg") :].replace(_INK, "currentColor").replace("xlink:href", "href")
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r' xmlns(:\w+)?="[^"]*"', "", text)
    text = re.sub(r'(id="|href="#|url\(#)', rf"\g<1>f{own}-", text)
    return text.replace("<svg ", '<svg class="chart" role="img" ', 1)


def steps_figure(steps: Sequence[str], panels: Mapping[str, Mapping[str, Sequence[float | None]]]) -> Figure:
    """Scalars over the steps, one panel per label.

    panels : label of the axis with its unit → name of the series → value per step; None is a gap
    """
    columns = min(2, len(panels))
    rows = -(-len(panels) // columns)
    with _style():
        figure = Figure(figsize=(4.4 * columns, 2.3 * rows + 0.5), layout="constrained")
        grid = figure.subplots(rows, columns, squeeze=False, sharex=True).ravel()
        for axes, (label, series) in zip(grid, panels.items(), strict=False):
            for (name, values), colour in zip(series.items(), _COLOURS, strict=False):
                axes.plot(np.array(values, dtype=float), "o-", color=colour, markersize=3, linewidth=1, label=name)
            _open(axes, label)
            if len(series) > 1:
                axes.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1, 1), ncols=3, borderpad=0)
        for axes in grid[len(panels) :]:
            axes.set_axis_off()
        for axes in grid[max(0, len(panels) - columns) : len(panels)]:
            axes.tick_params(labelbottom=True)
            _name_steps(axes, steps)
            axes.set_xlabel("step")
        return figure


def profile_figure(place: Array, series: Mapping[str, Array], place_label: str, label: str) -> Figure:
    """Values along a line; NaN is a gap. Both labels have their unit."""
    with _style():
        figure, axes = _one(5.2, 3.0)
        for (name, values), colour in zip(series.items(), _COLOURS * len(series), strict=False):
            axes.plot(place, values, color=colour, linewidth=1.2, label=name)
        _open(axes, label)
        axes.set_xlabel(place_label)
        if len(series) > 1:
            _legend_above(figure, axes)
        return figure


def _style() -> AbstractContextManager[None]:
    return matplotlib.rc_context(_STYLE)


def _one(width_in: float, height_in: float) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _open(axes: Axes, label: str) -> None:
    """An axis with light lines across and a scale that is read without adding an offset."""
    axes.set_ylabel(label)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#8884", linewidth=0.5)
    axes.ticklabel_format(axis="y", useOffset=False, scilimits=(-3, 4))


def _name_steps(axes: Axes, names: Sequence[str]) -> None:
    """Names below the places 0, 1, …; upright where they are few, and at most forty of them."""
    stride = -(-len(names) // 40) if names else 1
    long = len(names) > _MANY_STEPS or sum(map(len, names)) > 40
    axes.set_xticks(range(0, len(names), stride), names[::stride], rotation=90 if long else 0, fontsize=7)
    axes.set_xlim(-0.6, len(names) - 0.4)


def _legend_above(figure: Figure, axes: Axes) -> None:
    if handles := axes.get_legend_handles_labels()[0]:
        figure.legend(handles=handles, loc="outside upper center", ncols=min(5, len(handles)), fontsize=8)
