"""Charts of a measurement and of its calibration: figures from data alone, and figures as files."""

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
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from dicflow.core.camera import Camera, Rig

__all__ = [
    "coverage_figure",
    "epipolar_rows_figure",
    "pair_errors_figure",
    "profile_figure",
    "rig_figure",
    "saved",
    "steps_figure",
    "svg",
]

Array = NDArray[Any]

LEFT, RIGHT, THIRD = "#3b82b5", "#d95f02", "#4d9a3a"
_COLOURS = (LEFT, RIGHT, THIRD, "#a05cb0", "#b08d20", "#7a7a7a")
_INK = "#010203"
"""Stands for the colour of the text around the picture, until the SVG says ``currentColor``."""
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
    """A figure as an element of an HTML page: clear ground, the page's text colour, and no names of others' parts."""
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


def pair_errors_figure(pairs: Sequence[Mapping[str, Any]], limit_px: float | None = None) -> Figure:
    """Reprojection error of each pair in either camera.

    pairs : name, used and, where a board was found, left_px and right_px; a pair that was dropped is drawn hollow
    limit_px : drawn as a line
    """
    with _style():
        figure, axes = _one(max(4.0, 0.24 * len(pairs) + 1.2), 3.0)
        found = [(place, pair) for place, pair in enumerate(pairs) if "left_px" in pair]
        for shift, side, colour in ((-0.2, "left", LEFT), (0.2, "right", RIGHT)):
            for used, label in ((True, side), (False, f"{side}, dropped")):
                bars = [(place, pair[f"{side}_px"]) for place, pair in found if pair["used"] is used]
                if bars:
                    places, heights = np.array(bars).T
                    face = colour if used else "none"
                    axes.bar(places + shift, heights, width=0.38, color=face, edgecolor=colour, label=label)
        for place in sorted(set(range(len(pairs))) - {place for place, _ in found}):
            axes.annotate("no board", (place, 0), (0, 3), textcoords="offset points", rotation=90, ha="center", size=7)
        if limit_px is not None:
            axes.axhline(limit_px, color=_INK, linestyle=":", linewidth=1, label="limit")
        _name_steps(axes, [str(pair["name"]) for pair in pairs])
        axes.set(xlabel="pair of photographs", ylabel="reprojection error [px]")
        _legend_above(figure, axes)
        return figure


def coverage_figure(corners: Mapping[str, Sequence[Array]], image_size: tuple[int, int]) -> Figure:
    """Where the boards' corners lie in the frame of each camera.

    corners : camera → one array (n, 2) [px] per photograph
    image_size : (width, height) [px]
    """
    width, height = image_size
    panel_in = min(3.6, 4.0 * width / height)
    with _style():
        figure = Figure(figsize=(len(corners) * panel_in + 0.9, panel_in * height / width + 0.9), layout="constrained")
        panels = figure.subplots(1, len(corners), squeeze=False, sharey=True)[0]
        for axes, (side, boards), colour in zip(panels, corners.items(), _COLOURS, strict=False):
            points = np.concatenate([np.empty((0, 2)), *boards])
            axes.plot(points[:, 0], points[:, 1], ".", color=colour, markersize=2.5, rasterized=len(points) > 5000)
            axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", xlabel="x [px]", title=side)
            axes.xaxis.set_major_locator(MaxNLocator(4))
        panels[0].set_ylabel("y [px]")
        return figure


def rig_figure(rig: Rig, boards: Sequence[Array] = ()) -> Figure:
    """Both cameras and the boards as the left camera sees them in space: from above and from the side.

    boards : (n, 3) outline of each board in the left camera's frame [mm]
    """
    outlines = [np.vstack([board, board[:1]]) for board in boards]
    reach = np.concatenate([*outlines, rig.translation[None]]) if outlines else rig.translation[None] * 3
    size = 0.12 * float(np.linalg.norm(np.ptp(np.vstack([reach, np.zeros(3)]), axis=0)))
    left = _frustum(rig.left, size)
    right = (_frustum(rig.right, size) - rig.translation) @ rig.rotation
    with _style():
        figure = Figure(figsize=(8.6, 4.0), layout="constrained")
        panels = figure.subplots(1, 2)
        views = (("from above", "X [mm]", "Z [mm]", 0, 2), ("from the side", "Z [mm]", "Y [mm]", 2, 1))
        for axes, (title, x_label, y_label, x, y) in zip(panels, views, strict=True):
            for outline in outlines:
                axes.fill(outline[:, x], outline[:, y], color=THIRD, alpha=0.12, linewidth=0)
                axes.plot(outline[:, x], outline[:, y], color=THIRD, linewidth=0.8)
            for body, colour, name in ((left, LEFT, "left camera"), (right, RIGHT, "right camera")):
                axes.plot(body[:, x], body[:, y], color=colour, linewidth=1.4, label=name)
            if outlines:
                axes.plot([], [], color=THIRD, label="boards")
            axes.set(title=title, xlabel=x_label, ylabel=y_label)
            axes.set_aspect("equal", adjustable="datalim")
            axes.grid(color="#8884", linewidth=0.5)
        panels[1].invert_yaxis()
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
        return figure


def epipolar_rows_figure(left: Array, right: Array, count: int = 12) -> Figure:
    """A rectified pair side by side with lines along rows: what is on a line at the left is on it at the right.

    left, right : (row, col) grey levels
    """
    height, width = left.shape
    stride = max(1, max(height, width) // 500)
    panel_in = min(4.2, 4.4 * width / height)
    with _style():
        figure = Figure(figsize=(2 * panel_in + 0.7, panel_in * height / width + 0.8), layout="constrained", dpi=110)
        panels = figure.subplots(1, 2, sharey=True)
        for axes, image, side in zip(panels, (left, right), ("left", "right"), strict=True):
            rows, cols = image.shape
            edges = (-0.5, cols - 0.5, rows - 0.5, -0.5)
            axes.imshow(image[::stride, ::stride], cmap="gray", extent=edges, interpolation="nearest")
            for row in np.linspace(0, height, count + 2)[1:-1]:
                axes.axhline(row, color="#ffb000", linewidth=0.7)
            axes.set(title=f"{side}, rectified", xlabel="x [px]")
            axes.xaxis.set_major_locator(MaxNLocator(4))
        panels[0].set_ylabel("y [px]")
        return figure


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


def _frustum(camera: Camera, size: float) -> Array:
    """A pyramid in one line (n, 3), its tip in the camera's centre, as wide as it sees."""
    width, height = camera.size
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=float)
    matrix = camera.matrix
    rays = np.column_stack([(corners - matrix[:2, 2]) / np.diag(matrix)[:2], np.ones(4)]) * size
    tip = np.zeros(3)
    order = [tip, rays[0], rays[1], tip, rays[2], rays[1], rays[2], rays[3], tip, rays[0], rays[3]]
    return np.array(order)
