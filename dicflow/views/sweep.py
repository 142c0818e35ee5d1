"""The scalars of a sweep, side by side."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

__all__ = ["sweep_figure", "variant_labels"]

_COLUMNS = 3
_ALIKE = 1e-4
"""Values that differ by less of their size are not drawn; the table has all digits."""


def variant_labels(values: Sequence[Mapping[str, Any]]) -> list[str]:
    """A short label per variant: the swept values; parameters by their last name."""
    return ["\n".join(f"{key.rpartition('.')[2]} {_short(value)}" for key, value in row.items()) for row in values]


def sweep_figure(values: Sequence[Mapping[str, Any]], table: Sequence[Mapping[str, Any]]) -> Figure:
    """One panel per scalar that differs between the variants, one dot per variant.

    values : swept parameter → value, one mapping per variant
    table : rows as :meth:`dicflow.pipeline.Result.table` gives them
    """
    swept = set(values[0])
    scalars = [name for name in dict.fromkeys(key for row in table for key in row) if name not in swept]
    differing = [name for name in scalars if _differs([row.get(name, math.nan) for row in table])]
    rows = max(1, math.ceil(len(differing) / _COLUMNS))
    figure = Figure(figsize=(4.2 * _COLUMNS, 2.6 * rows + 0.6), dpi=100, layout="constrained")
    panels = list(figure.subplots(rows, _COLUMNS, squeeze=False).flat)
    labels = variant_labels(values)
    for axes, name in zip(panels, differing, strict=False):
        _panel(axes, name, [row.get(name, math.nan) for row in table], labels)
    for axes in panels[len(differing) :]:
        axes.set_axis_off()
    figure.suptitle("Variants of the sweep, means over the steps", fontsize=11)
    return figure


def _panel(axes: Axes, name: str, heights: Sequence[float], labels: Sequence[str]) -> None:
    """One scalar; the scale starts at zero where that leaves the dots apart."""
    axes.plot(range(len(heights)), heights, "o", color="#31688e", clip_on=False)
    axes.set_xticks(range(len(labels)), labels, fontsize=7)
    axes.set_xlim(-0.5, len(labels) - 0.5)
    axes.set_title(name, fontsize=9)
    axes.tick_params(axis="y", labelsize=7)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.yaxis.get_offset_text().set_fontsize(7)
    axes.grid(axis="y", color="0.9")
    axes.margins(y=0.15)
    finite = np.array([height for height in heights if math.isfinite(height)])
    if np.ptp(finite) > 0.2 * np.abs(finite).max():
        if finite.min() >= 0:
            axes.set_ylim(bottom=0)
        elif finite.max() <= 0:
            axes.set_ylim(top=0)


def _differs(column: Sequence[float]) -> bool:
    finite = np.array([value for value in column if math.isfinite(value)])
    return finite.size > 1 and bool(np.ptp(finite) > _ALIKE * np.abs(finite).max())


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return " ".join(f"{key}{_short(inner)}" for key, inner in value.items())
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)
