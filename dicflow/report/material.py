"""Section: stress over stretch, loops, fitted models and what the tests say of the material."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from markupsafe import Markup

from dicflow.core.material.models import MODELS
from dicflow.core.material.modes import MODES, principal_stretches
from dicflow.core.material.response import nominal_stress
from dicflow.kinds.curve import StressCurve
from dicflow.kinds.material import FittedConstant, FittedCurve, FittedModel, Material
from dicflow.report.context import Context, Section
from dicflow.report.rendering import render
from dicflow.report.words import number, percent
from dicflow.views.line_charts import Curve, chart_over_values

__all__ = ["PLACE", "TITLE", "material"]

PLACE = 7
TITLE = "Material"

_LINES = 3
"""Models that are drawn: the best ones."""
_SAMPLES = 60
_TWICE = 2.0
"""Standard uncertainties in half an interval of 95 %."""
_SUMMARY = (
    ("largest_stretch", "largest stretch", ""),
    ("largest_stress_MPa", "largest nominal stress", "MPa"),
    ("loading_work_mJ_mm3", "work of loading", "mJ/mm³"),
    ("unloading_work_mJ_mm3", "work given back", "mJ/mm³"),
    ("loop_work_mJ_mm3", "area of the loop", "mJ/mm³"),
    ("set", "set", ""),
    ("set_under_load", "set, under load", ""),
)
_AXES = ("stretch [–]", "nominal stress [MPa]")


def material(context: Context) -> Section | None:
    """The section; None without a curve of stress and stretch."""
    result = context.result
    curves = {name: StressCurve.read(result.product(name)) for name in result.stages_of("curve") if result.has(name)}
    fits = {name: Material.read(result.product(name)) for name in result.stages_of("material") if result.has(name)}
    if not curves and not fits:
        return None
    body = render(
        "material.html",
        curves=[_curve_part(context, name, curve) for name, curve in curves.items()],
        columns=[("", ""), *((name, "number") for name in curves)],
        rows=list(_summary_rows(curves)),
        fits=[_fit_part(context, name, found) for name, found in fits.items()],
    )
    warnings = [f"{name}: {text}." for name, found in fits.items() for text in found.product.warnings]
    return Section("material", TITLE, body, tuple(warnings), covers=tuple(fits))


def _curve_part(context: Context, name: str, curve: StressCurve) -> tuple[str, Markup]:
    """Caption and chart of one curve."""
    caption = f"{name}, {curve.mode}: nominal stress over stretch, with intervals of 95 %; unloading hollow"
    return caption, _kept(context, name, "curve", lambda: chart_over_values([_measured(name, curve)], *_AXES))


def _measured(name: str, curve: StressCurve) -> Curve:
    hollow = np.array([phase == "unloading" for phase in curve.phases])
    halves = [_half(curve, quantity) for quantity in ("stretch", "nominal_stress")]
    return Curve(name, curve["stretch"], curve["nominal_stress"], hollow, x_half=halves[0], y_half=halves[1])


def _half(curve: StressCurve, quantity: str) -> np.ndarray:
    """Half the interval of 95 % at every step, both shares of the uncertainty together."""
    common = curve[f"common_{quantity}"]
    independent = curve[f"u_{quantity}"] if f"u_{quantity}" in curve else np.zeros(len(common))
    found: np.ndarray = _TWICE * np.hypot(independent, common)
    return found


def _summary_rows(curves: Mapping[str, StressCurve]) -> Iterator[list[str]]:
    """One row per quantity that some curve has, one cell per curve."""
    for key, title, unit in _SUMMARY:
        cells = [_with_interval(curve.summary, key) for curve in curves.values()]
        if any(cell != "–" for cell in cells):
            yield [f"{title} [{unit}]" if unit else title, *cells]


def _with_interval(summary: Mapping[str, float], key: str) -> str:
    if key not in summary:
        return "–"
    u = summary.get(f"u_{key}")
    return number(summary[key]) + (f" ± {number(_TWICE * u, 2)}" if u else "")


def _fit_part(context: Context, name: str, found: Material) -> Mapping[str, object]:
    """What the template shows of one fit."""
    warned = {f"{text}." for text in found.product.warnings}
    return {
        "title": name,
        "verdict": [(sentence, sentence in warned) for sentence in found.verdict],
        "columns": [("model", ""), *((title, "number") for title in ("AICc", "rms", "μ0 [MPa]")), ("constants", "")],
        "rows": [_model_row(model) for model in found.models],
        "prediction_columns": [("left out", ""), *((model.title, "number") for model in found.models)],
        "predictions": _prediction_rows(found),
        "charts": [
            *(
                (_caption(curve), _kept(context, name, f"fit {index}", lambda: _fit_chart(found, index)))  # noqa: B023
                for index, curve in enumerate(found.curves)
            ),
            (_residual_caption(found), _kept(context, name, "residuals", lambda: _residual_chart(found))),
        ],
        "correlations": [(model.title, _correlation(model)) for model in found.models[:1] if len(model.constants) > 1],
    }


def _caption(curve: FittedCurve) -> str:
    return f"{curve.name}, {curve.mode}: measured, and the best fits to all curves"


def _residual_caption(found: Material) -> str:
    title = found.models[0].title
    if found.is_of_fields:
        balance = f"Force balance: load that the mean stress of {title} carries, less the measured one, at every step"
        return f"{balance}; bars: 95 % by the load alone"
    return f"Residuals of {title}: stress of the model less the measured one"


def _residual_chart(found: Material) -> str:
    """Residuals of the best model at all points, relative to the stress, a line for each curve."""
    lines = []
    for index, curve in enumerate(found.curves):
        stretch, stress = (found.of_curve(name, index) for name in ("stretch", "nominal_stress"))
        percent_off = 100.0 * (found.of_curve(f"stress_{found.models[0].name}", index) / stress - 1.0)
        half = 100.0 * _TWICE * found.of_curve("u_stress", index) / np.abs(stress)
        lines.append(Curve(curve.name, stretch, percent_off, np.zeros(len(stretch), bool), y_half=half))
    label = "imbalance [% of the load]" if found.is_of_fields else "residual [% of the measured stress]"
    return chart_over_values(lines, _AXES[0], label)


def _model_row(model: FittedModel) -> list[str]:
    shear, half = model.shear_modulus
    constants = ", ".join(_constant(one) for one in model.constants)
    unstable = ", ".join(f"{mode} from {stretch:.2f}" for mode, stretch in model.unstable.items())
    return [
        model.title,
        number(model.aicc),
        percent(model.rms_all),
        f"{number(shear)} ± {number(half, 2)}",
        constants + (f"; unstable: {unstable}" if unstable else ""),
    ]


def _constant(one: FittedConstant) -> str:
    unit = " MPa" if one.unit == "MPa" else ""
    interval = " (at its limit)" if one.at_limit else f" ± {number(one.half_width, 2)}"
    return f"{one.name} = {number(one.value)}{interval}{unit}"


def _prediction_rows(found: Material) -> list[list[str]]:
    """Errors by which each curve is predicted from the others; empty with one curve."""
    if len(found.curves) < 2:
        return []
    return [
        [f"{curve.name} ({curve.mode})", *(percent(model.left_out[index]) for model in found.models)]
        for index, curve in enumerate(found.curves)
    ]


def _correlation(model: FittedModel) -> tuple[list[tuple[str, str]], list[list[str]]]:
    """Columns and rows of the correlation matrix, with the condition of the fit in the corner."""
    names = [one.name for one in model.constants]
    columns = [(f"condition {number(model.condition, 2)}", ""), *((name, "number") for name in names)]
    rows = [
        [name, *(f"{value:+.2f}".replace("-", "−") for value in row)]
        for name, row in zip(names, model.correlation, strict=True)
    ]
    return columns, rows


def _fit_chart(found: Material, index: int) -> str:
    """Points of one curve and the best models through them."""
    stretch, lateral = (found.of_curve(name, index) for name in ("stretch", "lateral_stretch"))
    points = Curve(
        found.curves[index].name,
        stretch,
        found.of_curve("nominal_stress", index),
        np.zeros(len(stretch), bool),
        joined=False,
        x_half=_TWICE * found.of_curve("u_stretch", index),
        y_half=_TWICE * found.of_curve("u_stress", index),
    )
    if found.is_of_fields:
        lines = [_field_line(found, model, index) for model in found.models[:_LINES]]
    else:
        along = _line(found.curves[index].mode, stretch, lateral)
        lines = [_model_line(model, along) for model in found.models[:_LINES]]
    return chart_over_values([points, *lines], *_AXES)


def _field_line(found: Material, model: FittedModel, index: int) -> Curve:
    """Mean stress of the field of one sheet."""
    stretch, stress = (found.of_curve(name, index) for name in ("stretch", f"stress_{model.name}"))
    return Curve(model.title, stretch, stress, np.zeros(len(stretch), bool), marked=False)


def _line(mode: str, stretch: np.ndarray, lateral: np.ndarray) -> np.ndarray:
    """Principal stretches along a curve, (n, 3): evenly spaced, or those measured in the mode biaxial."""
    if mode in MODES:
        return principal_stretches(mode, np.linspace(min(1.0, stretch.min()), stretch.max(), _SAMPLES))
    order = np.argsort(stretch)
    return principal_stretches(mode, stretch[order], lateral[order])


def _model_line(model: FittedModel, stretches: np.ndarray) -> Curve:
    stress = nominal_stress(MODELS[model.name], np.array(model.values), stretches)
    return Curve(model.title, stretches[:, 0], stress, np.zeros(len(stress), bool), marked=False)


def _kept(context: Context, stage: str, what: str, draw: object) -> Markup:
    """A chart, drawn once for the product of a stage."""

    def drawn() -> bytes:
        return str(draw()).encode()  # type: ignore[operator]

    return Markup(context.pieces.get(["material", what, context.result.digest(stage)], drawn).decode())
