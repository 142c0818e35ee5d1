"""Displacement and strain over load or over the steps, as SVG that stands inside a page."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from dicflow.views.line_charts import Curve, chart_over_steps, chart_over_values

__all__ = ["load_curves"]

Values = Mapping[str, Sequence[float | None]]

_NAMES = {"dic": "DIC", "caliper": "caliper"}


def load_curves(steps: Sequence[str], phases: Sequence[str], values: Values) -> list[str]:
    """A plot of the displacements or lengths, one of the strains; over load if it is known, else over the steps.

    phases : loading or unloading per step; unloading is drawn hollow
    values : as :func:`dicflow.report.history.step_history` gives them; None is a gap
    """
    return [_drawn(title, keys, steps, phases, values) for title, keys in _plots(values)]


def _drawn(title: str, keys: Sequence[str], steps: Sequence[str], phases: Sequence[str], values: Values) -> str:
    ordered = sorted(keys, key=_is_caliper)
    if "load_g" not in values:
        return chart_over_steps(steps, {_label(key): values[key] for key in ordered}, title)
    load = _numbers(values["load_g"])
    hollow = np.array([phase == "unloading" for phase in phases] or [False] * len(load))
    curves = [Curve(_label(key), load, _numbers(values[key]), hollow, _is_caliper(key)) for key in ordered]
    return chart_over_values(curves, "load [g]", title)


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


def _is_caliper(key: str) -> bool:
    return key.startswith("caliper")


def _label(key: str) -> str:
    """What a series is called beside its plot."""
    source = _NAMES.get(key.partition("_")[0])
    return source or re.sub(r"_(mm|px)$", "", key).removeprefix("mean_").replace("_", " ")


def _numbers(column: Sequence[float | None]) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in column], dtype=float)
