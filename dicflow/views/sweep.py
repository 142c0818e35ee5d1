"""The variants of a sweep side by side: their scalars, the same step by step, and their fields."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dicflow.engine.product import Product
from dicflow.kinds.maps import colour_range, joined_range
from dicflow.kinds.total import Total
from dicflow.views.colours import look, palette
from dicflow.views.crops import point_box
from dicflow.views.map_pictures import contact_sheet, map_levels
from dicflow.views.variant_names import last_name, short_value, variant_labels, variant_names
from dicflow.views.windows import MapWindow, with_margin

__all__ = ["differing", "small_multiples", "step_figure", "sweep_figure"]

_COLUMNS, _TICKS = 3, 8
_HIGHEST_PX = 900
"""Height that the fields of all variants may have together."""
_MOST_LABELS, _MOST_LETTERS, _MOST_KEYS = 8, 56, 16
"""Variants that are named below a panel, letters for which it has room, and variants in a key; more are numbered."""
_UNITS = {"mm": "mm", "px": "px", "mm2": "mm²", "deg": "deg", "pct": "%", "grey": "grey level"}
_ALIKE = 1e-4
"""Values that differ by less of their size are not drawn; the table has all digits."""


def sweep_figure(values: Sequence[Mapping[str, Any]], table: Sequence[Mapping[str, Any]]) -> Figure:
    """One panel per scalar that differs between the variants, one dot per variant.

    values : swept parameter → value, one mapping per variant
    table : rows as :meth:`dicflow.pipeline.Result.table` gives them
    """
    names = differing(values, table)
    figure, panels = _panels(len(names))
    parameters = list(dict.fromkeys(key for row in values for key in row))
    alone = parameters[0] if len(parameters) == 1 else None
    labels = variant_labels(values) if alone is None else [short_value(row[alone]) for row in values]
    label = "" if alone is None else last_name(alone)
    if not _have_room(labels):
        labels, label = [f"#{number}" for number in range(1, len(values) + 1)], "variant"
    for axes, name in zip(panels, names, strict=False):
        _panel(axes, name, [row.get(name, math.nan) for row in table], labels)
        axes.set_xlabel(label, fontsize=8)
    figure.suptitle("Variants of the sweep, means over the steps", fontsize=11)
    return figure


def differing(values: Sequence[Mapping[str, Any]], table: Sequence[Mapping[str, Any]]) -> list[str]:
    """Names of the scalars that differ between the variants."""
    scalars = [name for name in dict.fromkeys(key for row in table for key in row) if name not in values[0]]
    return [name for name in scalars if _differs([row.get(name, math.nan) for row in table])]


def step_figure(
    values: Sequence[Mapping[str, Any]], curves: Mapping[str, Sequence[Sequence[float]]], steps: Sequence[str]
) -> Figure:
    """One panel per scalar with one curve per variant over the steps.

    curves : scalar → for each variant one number per step, NaN if unknown
    """
    figure, panels = _panels(len(curves))
    labels = variant_names(values)
    colours = palette("viridis", len(values) + 1)[:-1] / 255.0
    for axes, (name, rows) in zip(panels, curves.items(), strict=False):
        for label, colour, heights in zip(labels, colours, rows, strict=True):
            axes.plot(range(len(steps)), heights, ".-", color=colour, label=label)
        shown = range(0, len(steps), max(1, math.ceil(len(steps) / _TICKS)))
        axes.set_xticks(list(shown), [steps[place] for place in shown], fontsize=7, rotation=30, ha="right")
        _dress(axes, name)
    if len(values) <= _MOST_KEYS:
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8)
    else:
        figure.suptitle(f"variants from #1, dark, to #{len(values)}, bright", fontsize=9)
    return figure


def small_multiples(totals: Sequence[Product], labels: Sequence[str], quantity: str) -> bytes:
    """The same field of every variant at one step, in one colour range over the specimen, as a PNG."""
    places = np.concatenate([total["xyz"][..., :2].reshape(-1, 2) for total in totals])
    first = Total.read(totals[0])
    window = MapWindow(with_margin(point_box(places) or (0.0, 0.0, 1.0, 1.0)), first.unit, "xyz")
    title, unit = first.title(quantity), first.unit_of(quantity)
    every = np.concatenate([total[quantity].ravel() for total in totals])
    chosen = look(quantity, title, unit, *joined_range([colour_range(every)]))
    maps = [map_levels(total, chosen, window) for total in totals]
    return contact_sheet(maps, labels, chosen, window, title, _HIGHEST_PX)


def _panels(count: int) -> tuple[Figure, list[Axes]]:
    """A figure with at least so many panels; the remaining ones are empty."""
    rows = max(1, math.ceil(count / _COLUMNS))
    figure = Figure(figsize=(4.2 * _COLUMNS, 2.6 * rows + 0.6), dpi=100, layout="constrained")
    panels = list(figure.subplots(rows, _COLUMNS, squeeze=False).flat)
    for axes in panels[count:]:
        axes.set_axis_off()
    return figure, panels


def _dress(axes: Axes, name: str) -> None:
    """Title, unit and grid of a panel."""
    axes.set_title(name, fontsize=9)
    axes.set_ylabel(f"[{_unit(name)}]", fontsize=8)
    axes.tick_params(axis="y", labelsize=7)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.yaxis.get_offset_text().set_fontsize(7)
    axes.grid(axis="y", color="0.9")
    axes.margins(y=0.15)


def _unit(name: str) -> str:
    """The unit that the name of a scalar ends in."""
    return _UNITS.get(name.rpartition("_")[2], "–")


def _have_room(labels: Sequence[str]) -> bool:
    """Whether labels of variants fit side by side below a panel."""
    letters = max(len(line) + 1 for label in labels for line in label.split("\n"))
    return len(labels) <= _MOST_LABELS and letters * len(labels) <= _MOST_LETTERS


def _panel(axes: Axes, name: str, heights: Sequence[float], labels: Sequence[str]) -> None:
    """One scalar; the scale starts at zero if the dots remain distinct."""
    axes.plot(range(len(heights)), heights, "o", color="#31688e", clip_on=False)
    shown = range(0, len(labels), math.ceil(len(labels) / _MOST_LABELS))
    axes.set_xticks(shown, [labels[place] for place in shown], fontsize=7)
    axes.set_xlim(-0.5, len(labels) - 0.5)
    _dress(axes, name)
    finite = np.array([height for height in heights if math.isfinite(height)])
    if np.ptp(finite) > 0.2 * np.abs(finite).max():
        if finite.min() >= 0:
            axes.set_ylim(bottom=0)
        elif finite.max() <= 0:
            axes.set_ylim(top=0)


def _differs(column: Sequence[float]) -> bool:
    finite = np.array([value for value in column if math.isfinite(value)])
    return finite.size > 1 and bool(np.ptp(finite) > _ALIKE * np.abs(finite).max())
