"""Differences between two measurements as maps over the photograph's plane."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dicflow.comparison.difference import Difference
from dicflow.views.colours import DIVERGING

__all__ = ["difference_maps"]

_COLUMNS, _WIDTH_IN, _ALONE_IN = 3, 3.6, 7.0
_PERCENTILE = 99.0
"""Percentile of the sizes at which the colours end; larger values have the colour of the end."""


def difference_maps(differences: Sequence[Difference]) -> Figure:
    """One quantity at several steps, A less B, in one colour range about zero."""
    first = differences[0]
    seen = [one.places[np.isfinite(one.values)] for one in differences]
    places = np.concatenate(seen)
    low, high = (places.min(axis=0), places.max(axis=0)) if len(places) else (np.zeros(2), np.ones(2))
    width, height = np.maximum(high - low, 1.0) * 1.06
    columns = min(_COLUMNS, len(differences))
    rows = math.ceil(len(differences) / columns)
    panel_in = _ALONE_IN if len(differences) == 1 else _WIDTH_IN
    high_in = min(1.2 * panel_in, panel_in * height / width)
    figure = Figure(figsize=(panel_in * columns + 1.0, (high_in + 0.5) * rows + 0.3), dpi=90, layout="constrained")
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    limit = _limit(differences)
    shown = [
        _panel(axes, one, (low, high), panel_in / width, limit) for axes, one in zip(panels, differences, strict=False)
    ]
    for axes in panels[len(differences) :]:
        axes.set_axis_off()
    unit = "–" if first.unit in ("", "1") else first.unit
    bar = figure.colorbar(shown[0], ax=panels, extend="both", aspect=30)
    bar.set_label(f"{first.quantity}: A − B [{unit}]")
    return figure


def _limit(differences: Sequence[Difference]) -> float:
    sizes = np.concatenate([np.abs(one.values[np.isfinite(one.values)]) for one in differences])
    return max(float(np.percentile(sizes, _PERCENTILE)), 1e-12) if sizes.size else 1.0


def _panel(
    axes: Axes,
    difference: Difference,
    frame: tuple[NDArray[np.float64], NDArray[np.float64]],
    inches_per_px: float,
    limit: float,
) -> PathCollection:
    """The points as squares that touch their neighbours."""
    known = np.isfinite(difference.values)
    x, y = difference.places[known].T if known.any() else np.empty((2, 0))
    (x0, y0), (x1, y1) = frame
    pitch = math.sqrt(max((x1 - x0) * (y1 - y0), 1.0) / max(1, known.sum()))
    points = axes.scatter(
        x,
        y,
        c=difference.values[known],
        s=max(1.0, (72 * pitch * inches_per_px) ** 2),
        marker="s",
        linewidths=0,
        cmap=DIVERGING,
        vmin=-limit,
        vmax=limit,
        rasterized=True,
    )
    margin = 0.03 * max(x1 - x0, y1 - y0, 1.0)
    axes.set(xlim=(x0 - margin, x1 + margin), ylim=(y1 + margin, y0 - margin), aspect="equal", facecolor="0.93")
    axes.set(xlabel="x [px]", ylabel="y [px]")
    axes.set_title(difference.step, fontsize=9)
    axes.tick_params(labelsize=7)
    return points
