"""Displacement and strain over load or over the steps, as SVG that stands inside a page."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from dicflow.views.plots import profile_figure, steps_figure, svg

__all__ = ["load_curves"]

Values = Mapping[str, Sequence[float | None]]

_NAMES = {"dic": "DIC", "caliper": "caliper"}
_MARKERS = {"caliper": ("s", 7.0, 3)}
"""Shape, size and layer of the marks; those of the caliper are larger and lie below."""


def load_curves(steps: Sequence[str], phases: Sequence[str], values: Values) -> list[str]:
    """A plot of the displacements or lengths, one of the strains; over load if it is known, else over the steps.

    phases : loading or unloading per step; unloading is drawn hollow
    values : as :func:`dicflow.report.history.step_history` gives them; None is a gap
    """
    drawn = []
    for title, keys in _plots(values):
        series = {_label(key): values[key] for key in sorted(keys, key=lambda key: key.startswith("caliper"))}
        if "load_g" in values:
            drawn.append(svg(_over_load(values["load_g"], phases, series, title)))
        else:
            drawn.append(svg(steps_figure(steps, {title: series})))
    return drawn


def _plots(values: Values) -> list[tuple[str, list[str]]]:
    """Title and values of each plot that has any."""
    unit = "px" if any(key.endswith("_px") for key in values) else "mm"
    selected = [key for key in values if "sigma" not in key and "error" not in key]
    lengths = [key for key in selected if "displacement" in key] or [
        key for key in selected if key.endswith(f"_{unit}")
    ]
    strains = [key for key in selected if not key.endswith(("_mm", "_px", "_g", "_pct"))]
    kind = "displacement" if all("length" not in key for key in lengths) else "length"
    return [(title, keys) for title, keys in ((f"{kind} [{unit}]", lengths), ("strain [–]", strains)) if keys]


def _over_load(load: Sequence[float | None], phases: Sequence[str], series: Values, title: str) -> Figure:
    """Lines through the steps in their order, with a full or hollow mark at each."""
    x = _numbers(load)
    figure = profile_figure(x, {name: _numbers(column) for name, column in series.items()}, "load [g]", title)
    hollow = np.array([phase == "unloading" for phase in phases] or [False] * len(x))
    axes = figure.axes[0]
    for name, line in zip(series, list(axes.lines), strict=True):
        colour, y = line.get_color(), _numbers(series[name])
        marker, size, layer = _MARKERS.get(name, ("o", 4.0, 4))
        line.set_alpha(0.5)
        axes.plot(x[~hollow], y[~hollow], marker, color=colour, markersize=size, zorder=layer)
        axes.plot(x[hollow], y[hollow], marker, color=colour, markersize=size, zorder=layer, markerfacecolor="none")
    return figure


def _label(key: str) -> str:
    """What a series is called beside its plot."""
    source = _NAMES.get(key.partition("_")[0])
    return source or re.sub(r"_(mm|px)$", "", key).removeprefix("mean_").replace("_", " ")


def _numbers(column: Sequence[float | None]) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in column], dtype=float)
