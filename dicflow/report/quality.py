"""Section: uncertainty, convergence, quality of the speckle pattern."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from markupsafe import Markup

from dicflow.kinds.correlation import Correlation
from dicflow.kinds.noise_floor import NoiseFloorTable
from dicflow.kinds.quantities import DISPLACEMENTS, STRAINS, symbol_of
from dicflow.pipeline import Result
from dicflow.report.context import Context, Section
from dicflow.report.measured import pattern
from dicflow.report.rendering import render
from dicflow.report.rest import at_rest
from dicflow.report.step_summaries import step_summaries
from dicflow.report.words import number, percent

__all__ = ["PLACE", "TITLE", "advice_on", "quality"]

PLACE = 30
TITLE = "Quality"

_GOOD_SPECKLE_PX = (3.0, 7.0)
_LEAST_SPECKLES = 3.0
_LEAST_GRADIENT = 5.0
_LEAST_CONTRAST = 0.1
_MOST_SATURATED = 0.01


class _Panel(NamedTuple):
    """Figures that are drawn together, and the axis that they share."""

    title: str
    axis: str


class _Figure(NamedTuple):
    """A figure of each step, from the summary of a product of some kind."""

    panel: _Panel
    series: str
    kind: str
    key: str


_MILLIMETRES = _Panel("Uncertainty u of the displacement, median over the points", "u [mm]")
_PIXELS = _MILLIMETRES._replace(axis="u [px]")
_STRAIN = _Panel("Uncertainty u of the strain, median over the points", "u [–]")
_MISFIT = _Panel("Misfit of the grey levels, median over the points", "ZNSSD [–]")
_DISTANCES = _Panel("Epipolar distance and reprojection error, root mean square", "distance [px]")
_ITERATIONS = _Panel("Iterations of the correlation", "iterations [–]")
_RESIDUAL = _Panel("Residual of the features that were followed", "residual [px]")
_FEATURES = _Panel("Features that agree on the motion", "features [–]")
_DISPARITY = _Panel("Share of pixels with a disparity", "share [–]")
_SURFACE = _Panel("Distance of the surface from its points, root mean square", "RMSE [mm]")

_FIGURES = (
    *(_Figure(_MILLIMETRES, name, "total", f"u_{name}_mm") for name in DISPLACEMENTS),
    *(_Figure(_PIXELS, name, "total", f"u_{name}_px") for name in "UV"),
    *(_Figure(_STRAIN, symbol_of(name), "total", f"u_{name}") for name in STRAINS),
    _Figure(_MISFIT, "left", "correlation", "znssd"),
    _Figure(_DISTANCES, "epipolar", "stereo", "epipolar_px"),
    _Figure(_DISTANCES, "reprojection", "points", "reprojection_px"),
    _Figure(_ITERATIONS, "left, median", "correlation", "iterations"),
    _Figure(_ITERATIONS, "right, mean", "stereo", "iterations"),
    _Figure(_RESIDUAL, "residual", "track", "residual_px"),
    _Figure(_FEATURES, "features", "track", "inliers"),
    _Figure(_DISPARITY, "share", "disparity", "valid_share"),
    *(_Figure(_SURFACE, axis.upper(), "cloud", f"rmse_{axis}_mm") for axis in "xyz"),
)

_Panels = dict[_Panel, dict[str, list[float | None]]]


def quality(context: Context) -> Section | None:
    """The section, None if no points were followed."""
    result = context.result
    followed = [stage for kind in ("correlation", "track") for stage in result.stages_of(kind)]
    if not followed:
        return None
    steps = result.steps(followed[0])
    panels = _panels(context, steps)
    speckle = pattern(context)
    advice = advice_on(speckle, _subset(result)) if speckle is not None else []
    rest = at_rest(context.result, context.piece)
    names = [(_heading(panel, name), "number") for panel, series in panels.items() for name in series]
    body = render(
        "quality.html",
        speckle=_facts(speckle) if speckle is not None else [],
        advice=advice,
        noise=_noise_of_photographs(result, followed[0]),
        charts=[(panel.title, _chart(context, steps, panel, series)) for panel, series in panels.items()],
        columns=[("step", ""), *names],
        rows=_rows(steps, panels),
        predicts=bool(result.stages_of("correlation")),
        floor=_noise_floor(result),
        rest=rest,
    )
    shaken = (rest.warning,) if rest is not None and rest.warning else ()
    warnings = (*shaken, *(sentence for good, sentence in advice if not good), *_overexposed(context))
    return Section("quality", TITLE, body, warnings)


def _panels(context: Context, steps: Sequence[str]) -> _Panels:
    """The figures that some step has: panel → series → one value per step, None if unknown."""
    panels: _Panels = {}
    summaries: dict[str, Mapping[str, Mapping[str, Any]]] = {}
    for figure in _FIGURES:
        for stage in context.result.stages_of(figure.kind):
            if stage not in summaries:
                summaries[stage] = step_summaries(context, stage)
            values = [summaries[stage].get(step, {}).get(figure.key) for step in steps]
            if any(value is not None for value in values):
                panels.setdefault(figure.panel, {})[figure.series] = values
    return panels


def _heading(panel: _Panel, series: str) -> str:
    """Title of a column; a series with the name of its axis is not named twice."""
    named = panel.axis.startswith(f"{series} [")
    return f"{panel.title}: {panel.axis}" if named else f"{panel.title}: {series}, {panel.axis}"


def _rows(steps: Sequence[str], panels: _Panels) -> list[list[str]]:
    columns = [values for series in panels.values() for values in series.values()]
    return [[step, *(number(values[row], 3) for values in columns)] for row, step in enumerate(steps)]


def _chart(
    context: Context, steps: Sequence[str], panel: _Panel, series: Mapping[str, Sequence[float | None]]
) -> Markup:
    def drawn() -> bytes:
        from dicflow.views.line_charts import chart_over_steps

        return chart_over_steps(steps, series, panel.axis).encode()

    return Markup(context.pieces.get(["figures of the steps", repr((steps, panel.axis, series))], drawn).decode())


def _facts(speckle: Mapping[str, float | None]) -> list[tuple[str, str, str]]:
    return [
        ("Speckle size", f"{number(speckle['size_px'], 2)} px", "diameter, from the autocorrelation"),
        ("Mean intensity gradient", number(speckle["gradient"], 3), "grey levels of 255 per px"),
        ("Contrast", percent(speckle["contrast"]), "standard deviation over mean of the grey levels"),
        ("Overexposed pixels", percent(speckle["saturated"]), "of the region"),
    ]


def advice_on(speckle: Mapping[str, float | None], subset_px: float | None) -> list[tuple[bool, str]]:
    """Whether each property is good, and a remedy if it is not."""
    low, high = _GOOD_SPECKLE_PX
    size, gradient, contrast = speckle["size_px"], speckle["gradient"], speckle["contrast"]
    if size is None or gradient is None or contrast is None:
        return [(False, "The region shows no pattern; choose it where the specimen is speckled.")]
    found = [(low <= size <= high, _size_sentence(size))]
    if subset_px is not None:
        enough = subset_px >= _LEAST_SPECKLES * size
        remedy = "" if enough else f"; take at least {_LEAST_SPECKLES * size:.0f} px"
        found.append((enough, f"A subset of {subset_px:g} px is {subset_px / size:.1f} speckles wide{remedy}."))
    finding = f"The mean intensity gradient of {gradient:.1f} is"
    steep = gradient >= _LEAST_GRADIENT
    remedy = "enough" if steep else "low: light the specimen better, focus, or paint it with more contrast"
    found.append((steep, f"{finding} {remedy}."))
    if contrast < _LEAST_CONTRAST:
        found.append((False, f"The contrast of {percent(contrast)} is low: paint the specimen blacker and whiter."))
    if (speckle["saturated"] or 0.0) > _MOST_SATURATED:
        found.append(
            (False, f"{percent(speckle['saturated'])} of the region is overexposed: expose for a shorter time.")
        )
    return found


def _size_sentence(size: float) -> str:
    low, high = _GOOD_SPECKLE_PX
    finding, good = f"Speckles of {size:.1f} px", f"{low:.0f} to {high:.0f} px are good"
    if size < low:
        return f"{finding} are small, which biases the interpolation; {good}, so paint coarser ones."
    if size > high:
        return f"{finding} are large and need large subsets; {good}, so paint finer ones."
    return f"{finding} are of a good size; {good}."


def _overexposed(context: Context) -> Iterator[str]:
    """A warning for each camera that was overexposed at a later step."""
    for side, kind in (("left", "correlation"), ("right", "stereo")):
        for stage in context.result.stages_of(kind):
            steps, summaries = context.result.steps(stage), step_summaries(context, stage)
            shares = {step: summaries.get(step, {}).get("overexposed_share") or 0.0 for step in steps[1:]}
            bad = {step: share for step, share in shares.items() if share > _MOST_SATURATED}
            if bad:
                worst = max(bad, key=lambda step: bad[step])
                yield (
                    f"The {side} photographs of {len(bad)} of {len(steps)} steps are overexposed in more than "
                    f"{percent(_MOST_SATURATED)} of the region, {worst} in {percent(bad[worst])}: "
                    "expose for a shorter time."
                )


def _subset(result: Result) -> float | None:
    """Side of a correlation's subset [px]."""
    for stage in result.stages_of("correlation"):
        if result.has(stage, 0):
            return float(Correlation.read(result.product(stage, 0)).grid.subset_size)
    return None


def _noise_of_photographs(result: Result, stage: str) -> str:
    """Basis of the standard deviations at the last step that the store holds."""
    there = [step for step in result.steps(stage) if result.has(stage, step)]
    if not there or result.product(stage, there[-1]).kind != "correlation":
        return ""
    last = Correlation.read(result.product(stage, there[-1]))
    return f"Noise of the photographs: {last.noise_grey:.2f} grey levels, from {last.noise_source}."


def _noise_floor(result: Result) -> list[list[str]]:
    """Rows of the noise table: step, quantity, bias, σ found and predicted, points."""
    return [
        [
            row["step"],
            f"{symbol_of(row['quantity'])} [{'–' if row['unit'] == '1' else row['unit']}]",
            *(number(row[name], 3) for name in ("bias", "sigma", "predicted_sigma")),
            str(row["points"]),
        ]
        for stage in result.stages_of("noise")
        if result.has(stage)
        for row in NoiseFloorTable.read(result.product(stage)).rows
    ]
