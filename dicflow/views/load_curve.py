"""Displacement and strain over load or over the steps, as SVG that stands inside a page."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

__all__ = ["load_curves"]

Values = Mapping[str, Sequence[float | None]]

_INK = "#010203"
"""Stands for the colour of the text around the picture, until the SVG says ``currentColor``."""
_COLOURS = {"caliper": "#d95f02", "dic": "#3b82b5"}
_OTHERS = ("#3b82b5", "#d95f02", "#4d9a3a", "#a05cb0", "#b08d20", "#7a7a7a")
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


def load_curves(steps: Sequence[str], phases: Sequence[str], values: Values) -> list[str]:
    """A plot of the displacements or lengths, one of the strains; over load where there is one, else over the steps.

    phases : loading or unloading per step; unloading is drawn hollow
    values : as :func:`dicflow.report.history.history` gives them; None is a gap
    """
    drawn = []
    for number, (title, chosen) in enumerate(_panels(values)):
        with mpl.rc_context(_STYLE):
            figure = Figure(figsize=(4.8, 3.2), layout="constrained")
            figure.patch.set_alpha(0.0)
            axes = figure.subplots()
            _draw(axes, title, {key: values[key] for key in chosen}, values.get("load_g"), phases)
            if "load_g" not in values:
                axes.set_xticks(range(len(steps)), steps, rotation=90 if len(steps) > 4 else 0, fontsize=7)
            drawn.append(_inline(figure, f"load{number}-"))
    return drawn


def _panels(values: Values) -> list[tuple[str, list[str]]]:
    """Title and values of each plot that has any."""
    unit = "px" if any(key.endswith("_px") for key in values) else "mm"
    wanted = [key for key in values if "sigma" not in key and "error" not in key]
    lengths = [key for key in wanted if "displacement" in key] or [key for key in wanted if key.endswith(f"_{unit}")]
    strains = [key for key in wanted if not key.endswith(("_mm", "_px", "_g", "_pct"))]
    kind = "displacement" if all("length" not in key for key in lengths) else "length"
    return [(title, keys) for title, keys in ((f"{kind} [{unit}]", lengths), ("strain [–]", strains)) if keys]


def _draw(axes: Axes, title: str, series: Values, load: Sequence[float | None] | None, phases: Sequence[str]) -> None:
    for (key, column), colour in zip(series.items(), _OTHERS * len(series), strict=False):
        y = _numbers(column)
        x = np.arange(len(y), dtype=float) if load is None else _numbers(load)
        hollow = np.array([phase == "unloading" for phase in phases] or [False] * len(y))[: len(y)]
        name = next((name for name in _COLOURS if key.startswith(f"{name}_")), "")
        colour = _COLOURS.get(name, colour)
        marker, size = ("s", 6.5) if name == "caliper" else ("o", 4.0)
        axes.plot(x, y, "-", color=colour, linewidth=0.8, alpha=0.6)
        axes.plot(x[~hollow], y[~hollow], marker, color=colour, markersize=size, label=_label(key, name))
        axes.plot(x[hollow], y[hollow], marker, color=colour, markersize=size, markerfacecolor="none")
    axes.set_xlabel("step" if load is None else "load [g]")
    axes.set_ylabel(title)
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="#8884", linewidth=0.5)
    if axes.lines:
        axes.legend(fontsize=8)


def _label(key: str, name: str) -> str:
    named = {"caliper": "caliper", "dic": "DIC"}
    return named.get(name) or re.sub(r"_(mm|px)$", "", key).removeprefix("mean_").replace("_", " ")


def _numbers(column: Sequence[float | None]) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in column], dtype=float)


def _inline(figure: Figure, prefix: str) -> str:
    """The figure as an element of an HTML page: no header, no addresses, the page's text colour.

    prefix : makes its ids unlike those of other figures in the page
    """
    written = io.StringIO()
    figure.savefig(written, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = written.getvalue()
    text = text[text.index("<svg") :].replace(_INK, "currentColor").replace("xlink:href", "href")
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r' xmlns(:\w+)?="[^"]*"', "", text)
    text = re.sub(r'(id="|href="#|url\(#)', rf"\1{prefix}", text)
    return text.replace("<svg ", '<svg class="chart" role="img" ', 1)
