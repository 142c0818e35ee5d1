"""Displacement and strain over load or over the steps, as SVG that stands inside a page."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dicflow.kinds.quantities import QUANTITIES
from dicflow.views.line_charts import Curve, chart_over_steps, chart_over_values

__all__ = ["Axis", "load_curves"]

Values = Mapping[str, Sequence[float | None]]

_NAMES = {"dic": "DIC", "caliper": "caliper"}


class Axis(NamedTuple):
    """What curves are drawn over. key : of its values; label : with the unit"""

    key: str
    label: str


_LOAD = Axis("load_g", "load [g]")


def load_curves(steps: Sequence[str], phases: Sequence[str], values: Values, axis: Axis = _LOAD) -> list[str]:
    """A plot of the displacements or lengths, one of the strains; over the axis if it is known, else over the steps.

    phases : loading or unloading per step; unloading is drawn hollow
    values : as :func:`dicflow.report.history.step_history` gives them; None is a gap
    """
    curves = {key: column for key, column in values.items() if key != axis.key}
    if axis.key not in values:
        return [_over_steps(title, keys, steps, values) for title, keys in _plots(curves)]
    return [_over_axis(title, keys, phases, values, axis) for title, keys in _plots(curves)]


def _over_steps(title: str, keys: Sequence[str], steps: Sequence[str], values: Values) -> str:
    return chart_over_steps(steps, {_label(key): values[key] for key in sorted(keys, key=_is_caliper)}, title)


def _over_axis(title: str, keys: Sequence[str], phases: Sequence[str], values: Values, axis: Axis) -> str:
    load = _numbers(values[axis.key])
    hollow = np.array([phase == "unloading" for phase in phases] or [False] * len(load))
    curves = [
        Curve(_label(key), load, _numbers(values[key]), hollow, _is_caliper(key))
        for key in sorted(keys, key=_is_caliper)
    ]
    return chart_over_values(curves, axis.label, title)


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
    bare = re.sub(r"_(mm|px)$", "", key).removeprefix("mean_")
    return source or (QUANTITIES[bare].symbol if bare in QUANTITIES else bare.replace("_", " "))


def _numbers(column: Sequence[float | None]) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in column], dtype=float)
