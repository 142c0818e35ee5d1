"""A rubber from photographs of three sheets: force balance, constants, predictions, intervals and verdicts.

Run it with ``python -m tests.accuracy_sheets``, or as part of ``make accuracy``; parts of it by their names: half,
whole, cycle, coverage. Photographs and measurements are kept in ``build/figures``, from where a run that was ended goes
on.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.interpolate import CubicSpline
from scipy.stats import norm

from dicflow.core.material.fit import Curve
from dicflow.core.material.models import MODELS
from dicflow.core.material.modes import principal_stretches
from dicflow.core.material.prediction import spread_of
from dicflow.core.material.response import nominal_stress
from dicflow.core.material.virtual_fields import Sheet, constants_of, piecewise_fields
from dicflow.engine.product import Product
from dicflow.kinds.curve import StressCurve
from dicflow.kinds.material import FittedModel, Material
from dicflow.kinds.sheet import SheetFields
from dicflow.pipeline import Result
from dicflow.stages import curve
from dicflow.stages._verdict import guesses_of, not_excluded
from dicflow.stages.hyperelastic import Hyperelastic
from dicflow.stages.virtual_fields import VirtualFields
from dicflow.synth.equilibrium import equilibrium
from dicflow.synth.sheets import CONSTANTS, GRAVITY, SHAPES, Rubber, loads_of, softened, write_sheets
from tests.bars import Figure
from tests.figures import WORK, made, pipeline_result, report, run_text

__all__ = ["GAUGE_POINTS", "sheets", "window_noise"]

MADE = tuple(Rubber(model, CONSTANTS[model]) for model in ("mooney_rivlin", "yeoh", "ogden_2"))
"""Rubbers that are photographed whole."""
DRAWN = tuple(
    Rubber(model, CONSTANTS[model], seed=seed)
    for seed, model in enumerate(("mooney_rivlin", "yeoh", "ogden_2", "mooney_rivlin", "yeoh", "ogden_2"), start=1)
)
"""Rubbers photographed at half the size: each seed has another thickness, other weights, speckles and noise."""
_MESHES = ((1, 1), (1, 6), (2, 2), (4, 4))
"""Cells of the virtual displacements across and along the load."""
_EQUIBIAXIAL = 1.6
"""Largest stretch of a prediction that stays within the I1 that the sheets reach."""


def sheets(names: Sequence[str] = ()) -> Iterator[Figure]:
    """All that is measured from photographs, then the coverage over many draws. names : of parts, all if none"""
    for name, part in PARTS.items():
        if not names or name in names:
            yield from part()


def half() -> Iterator[Figure]:
    """Photographs of half the size."""
    yield from _photographed(DRAWN, 0.5)


def whole() -> Iterator[Figure]:
    """Photographs of the whole size."""
    yield from _photographed(MADE, 1.0)


def _photographed(rubbers: Sequence[Rubber], scale: float) -> Iterator[Figure]:
    inside: list[bool] = []
    for rubber in rubbers:
        yield from _figures(rubber, _measured(rubber, scale), inside)
    quantity = f"sheets of {scale:g} times the size: intervals of 95 % that hold the constant, of {len(inside)}"
    yield Figure(quantity, 100 * float(np.mean(inside)), 90.0, at_least=True, unit="%")


def _measured(rubber: Rubber, scale: float) -> Result:
    name = f"sheets_{rubber.model}_{rubber.seed}"
    folder = made(name, lambda path: write_sheets(path, rubber, scale=scale, workers=2))
    return pipeline_result("latex_material", folder, f"store_{name}")


def _figures(rubber: Rubber, result: Result, inside: list[bool]) -> Iterator[Figure]:
    """Of one rubber. The stated thickness is wrong, which scales all stresses: this common share is taken out.

    inside : gets whether each interval holds the truth
    """
    found, title = Material.read(result.product("material")), f"sheets, {rubber.model} {rubber.seed}"
    model = next(one for one in found.models if one.name == rubber.model)
    common = rubber.true_thickness / rubber.thickness
    scale = [common if one.unit == "MPa" else 1.0 for one in model.constants]
    truth = np.array(rubber.constants)
    index = _order(model, truth)
    values, halves = (
        np.array([getattr(one, name) for one in model.constants])[index] for name in ("value", "half_width")
    )
    inside.extend((np.abs(values - truth) <= halves).tolist())
    print(f"\n{title}: constants {values / np.array(scale)[index]}, truth {truth}, thickness {common - 1:+.2%}")
    ratio = found[f"stress_{rubber.model}"] / found["nominal_stress"]
    large = found["stretch"] > 1.1
    yield Figure(
        f"{title}: largest imbalance of forces above 10 %", 100 * float(np.abs(ratio[large] - 1).max()), 0.5, unit="%"
    )
    if model.misfit_ratio is not None:
        yield Figure(f"{title}: weighted squares per degree of freedom", model.misfit_ratio)
    if MODELS[rubber.model].is_linear:
        errors = 100 * np.abs(values / np.array(scale)[index] / truth - 1.0)
        for one, error in zip(MODELS[rubber.model].constants, errors, strict=True):
            yield Figure(f"{title}: error of {one.name}", float(error), 1.0, unit="%")
    for mode, error in _stress_errors(model, rubber, float(found["stretch"].max())).items():
        yield Figure(f"{title}: largest error of the stress, {mode}", error, 1.0, unit="%")
    yield from _verdicts(title, rubber, result)
    if MODELS[rubber.model].is_linear and rubber in DRAWN:
        yield from _by_mesh(title, rubber, result)


def _by_mesh(title: str, rubber: Rubber, result: Result) -> Iterator[Figure]:
    """Errors of the constants with other meshes of the virtual displacements, from one cell to sixteen."""
    sheets_of, truth = [result.product(name) for name in SHAPES], np.array(rubber.constants)
    common, errors = rubber.true_thickness / rubber.thickness, []
    for mesh in _MESHES:
        found = Material.read(VirtualFields(models=(rubber.model,), mesh=mesh).run(sheets_of))
        errors.append(100 * np.abs(np.array(found.models[0].values) / common / truth - 1.0))
    for one, error in zip(MODELS[rubber.model].constants, np.max(errors, axis=0), strict=True):
        yield Figure(f"{title}: error of {one.name}, largest over meshes from 1 × 1 to 4 × 4", float(error), unit="%")


def _order(model: FittedModel, truth: np.ndarray) -> np.ndarray:
    """Order of the fitted constants in which they are those of the truth: Ogden's terms have none."""
    if MODELS[model.name].is_linear:
        return np.arange(len(truth))
    terms, wanted = np.argsort(model.values[1::2]), np.argsort(np.argsort(truth[1::2]))
    return (2 * terms[wanted][:, None] + np.arange(2)).ravel()


def _stress_errors(model: FittedModel, rubber: Rubber, most: float) -> dict[str, float]:
    """Largest error of the predicted stress by mode, beside the common share [%]."""
    found, common = {}, rubber.true_thickness / rubber.thickness
    for mode, end in (("uniaxial", most), ("planar", 1.9), ("equibiaxial", _EQUIBIAXIAL)):
        stretches = principal_stretches(mode, np.linspace(1.1, end, 50))
        exact = nominal_stress(MODELS[rubber.model], np.array(rubber.constants), stretches)
        fitted = nominal_stress(MODELS[model.name], np.array(model.values), stretches) / common
        found[mode] = 100 * float(np.abs(fitted / exact - 1.0).max())
    return found


def _verdicts(title: str, rubber: Rubber, result: Result) -> Iterator[Figure]:
    """What verdicts leave open or unchecked, and whether the truth is within what they state.

    The field between the grips of one strip may hold enough to leave no model open; then it must predict.
    """
    alone, joint = (Material.read(result.product(name)) for name in ("strips_alone", "material"))
    middle = Material.read(Hyperelastic().run([_middle_curve(title, SheetFields.read(result.product("strip")))]))
    parts = {"the strip's middle": middle, "the strip alone": alone, "all three shapes": joint}
    for part, one in parts.items():
        print(f"\n{title}, {part}", *one.verdict, sep="\n  ")
        yield Figure(f"{title}, {part}: truth outside the stated range", _outside(one, rubber), 0.0, unit="%")
    is_open, is_unchecked = (
        {part: any(words in text for text in one.verdict) for part, one in parts.items()}
        for words in ("cannot tell which holds", "could be checked")
    )
    for part in parts:
        is_said = is_open[part] or is_unchecked[part]
        bar = float(part != "all three shapes")
        yield Figure(f"{title}, {part}: says what it cannot tell", float(is_said), bar, at_least=bool(bar))
    yield Figure(f"{title}: the strip's middle leaves models open", float(is_open["the strip's middle"]))
    yield Figure(f"{title}: the strip alone leaves models open", float(is_open["the strip alone"]))
    if not is_open["the strip alone"]:
        error = max(_stress_errors(alone.models[0], rubber, float(alone["stretch"].max())).values())
        yield Figure(
            f"{title}: the strip alone, which leaves none open: largest error of the stress", error, 10.0, unit="%"
        )


def _middle_curve(title: str, sheet: SheetFields) -> Product:
    """The middle third of a strip as a uniaxial test: stretches along the load, and the load per section."""
    along = sheet["places"][:, 1] / sheet.facts.length
    inside = np.abs(along - 0.5) < 1.0 / 6.0
    fibres = np.linalg.norm(sheet["gradients"][:, inside][..., 1], axis=-1)
    stretch = np.average(fibres, axis=1, weights=sheet["areas"][inside])
    u_stretch = sheet["u_gradient"] * np.sqrt(min(1.0, sheet.facts.shared / inside.sum()))
    section = sheet.facts.width * sheet.facts.thickness
    stress, u_stress = sheet["forces"] / section, np.full(len(stretch), sheet.facts.u_force / section)
    path = WORK / f"{title.replace(', ', '_').replace(' ', '_')}.csv"
    header = "stretch,nominal_stress_MPa,u_stretch,u_nominal_stress_MPa"
    np.savetxt(
        path, np.stack([stretch, stress, u_stretch, u_stress], axis=1), delimiter=",", header=header, comments=""
    )
    share = sheet.facts.u_thickness / sheet.facts.thickness
    return curve.Curve(file=path.name, mode="uniaxial", common_stress=share).run(path)


def _outside(found: Material, rubber: Rubber) -> float:
    """How far the true stress is outside the range of what is not excluded, beside the common share, over modes [%]."""
    stretches = principal_stretches("biaxial", found["stretch"], found["lateral_stretch"])
    curves = [Curve("", "biaxial", stretches, found["nominal_stress"])]
    worst, common = 0.0, rubber.true_thickness / rubber.thickness
    for one in spread_of(guesses_of(not_excluded(found.models)), curves):
        stretches = principal_stretches(one.mode, np.array([one.stretch]))
        truth = common * float(nominal_stress(MODELS[rubber.model], np.array(rubber.constants), stretches)[0])
        worst = max(worst, one.least / truth - 1.0, 1.0 - one.most / truth)
    return 100.0 * worst


_CYCLE = """
dicflow: 1
stages:
  boards: {stage: images, left: "boards/left/*.png", right: "boards/right/*.png"}
  corners: {stage: corners, images: boards, size: [9, 6]}
  rig: {stage: calibrate, square: 14.5 mm, tangential: true}
  photos: {stage: images, left: "strip/photos/left/*.png", right: "strip/photos/right/*.png"}
  load: {stage: channels, images: photos, file: strip/weights.csv, u: {force: 0.1 g}}
  region: {stage: region, images: photos, file: strip/region.geojson}
  features: {stage: features, images: photos, detector: AKAZE}
  matches: {stage: match, images: photos, guided: false, refine: false}
  correlation: {stage: correlate, images: photos}
  stereo: {stage: stereo, images: photos}
  points: {stage: triangulate}
  total: {stage: deformation, points: points}
  sheet: {stage: sheet, thickness: 0.21 mm, u_thickness: 5 um}
  gauge: {stage: probes, extensometers: {middle: GAUGE}}
  curve: {stage: stress, probe: middle, thickness: 0.21 mm, u_thickness: 5 um}
"""
"""A strip up and down again; its width is that of the photographs."""


def hysteresis() -> Iterator[Figure]:
    """Loop and set of a strip that is loaded and unloaded, photographed at half the size.

    The thickness scales the measured loop and the imposed one, which is that of the weights, alike.
    """
    rubber = Rubber(up=6, down=5, damage=0.3)
    folder = made("sheets_cycle", lambda path: write_sheets(path, rubber, ("strip",), 0.5, workers=2))
    gauge = _gauge(folder)
    result = run_text("sheets_cycle", _CYCLE.replace("GAUGE", json.dumps(gauge)), folder)
    found = StressCurve.read(result.product("curve")).summary
    loop, imposed = found["loop_work_mJ_mm3"], _imposed_loop(rubber)
    print(
        f"\nsheets, cycle: loop {loop:.5f}, imposed {imposed:.5f} mJ/mm³; set {found['set']:.2e} ± {found['u_set']:.1e}"
    )
    yield Figure("sheets, cycle: error of the loop's area", 100 * abs(loop / imposed - 1.0), 1.0, unit="%")
    yield Figure(
        "sheets, cycle: set, imposed 0, in half intervals of 95 %", abs(found["set"]) / (2 * found["u_set"]), 1.0
    )


def _gauge(folder: Path) -> list[list[float]]:
    """Two points of the strip's middle line, at three and seven tenths of its height [px]."""
    outline = json.loads((folder / "strip" / "region.geojson").read_text())["features"][0]["geometry"]["coordinates"][0]
    least, most = np.min(outline, axis=0), np.max(outline, axis=0)
    x = float(least[0] + most[0]) / 2.0
    return [[round(x, 1), round(float(least[1] + share * (most[1] - least[1])), 1)] for share in (0.3, 0.7)]


def _imposed_loop(rubber: Rubber) -> float:
    """Area between loading and unloading of a gauge over three to seven tenths of the length [mJ/mm³]."""
    shape, (grams, _) = SHAPES["strip"], loads_of(rubber, SHAPES["strip"])
    share = np.linspace(0.0, 1.0, 25)
    peak = grams[rubber.up] * 1e-3 * GRAVITY
    lines = tuple(np.linspace(0.0, side, round(side / 2.0) + 1) for side in (shape.width, shape.length))
    model, forces = MODELS[rubber.model], share[1:] * peak / rubber.true_thickness
    moved = equilibrium(model, np.array(rubber.constants), lines, forces).moved[:, :, len(lines[0]) // 2, 1]
    ends = [[np.interp(part * shape.length, lines[1], one) for part in (0.3, 0.7)] for one in moved]
    stretch = np.append(1.0, 1.0 + np.diff(ends)[:, 0] / (0.4 * shape.length))
    lost = (share - softened(share, rubber.damage)) * peak / (shape.width * rubber.thickness)
    return float(CubicSpline(stretch, lost).integrate(1.0, stretch[-1]))


_DRAWS, _CELL_MM, _WINDOW, _SUBSET = 400, 2.5, 3, 2
"""Draws; side of the cells between points; side of windows and of subsets in points."""
GAUGE_POINTS = (_WINDOW - 1 + _SUBSET) ** 2
"""Points in a gauge of the noise."""
_U_FORCE, _U_THICKNESS = 0.1 * 9.80665e-3, 0.024
_U_GRADIENT = {"strip": (7e-4, 3.3e-3), "square": (6e-4, 1.9e-3), "wide": (6e-4, 7.6e-3)}
"""σ of the gradients at rest and at the largest load: 1.3 to 5.4 times those of photographs of half the size."""


def coverage() -> Iterator[Figure]:
    """Draws of the exact fields with noise of windows over subsets, as large as measured; that at rest is in all steps.

    The thickness, which all steps share, takes the quantiles of its distribution in random order.
    """
    for name in CONSTANTS:
        if name == "neo_hooke":
            continue
        truth, exact = np.array(CONSTANTS[name]), [_exact(name, shape) for shape in _U_GRADIENT]
        fields = [piecewise_fields(one, np.array([0.0, one.width]), np.linspace(0.0, one.length, 3)) for one in exact]
        rng, found = np.random.default_rng(23), []
        for share in rng.permutation(norm.ppf((np.arange(_DRAWS) + 0.5) / _DRAWS)):
            drawn = [_drawn(one, 1.0 + _U_THICKNESS * share, rng) for one in exact]
            found.append(constants_of(MODELS[name], drawn, fields, truth))
        yield from _covered(name, truth, [one.constants for one in found], [one.covariance for one in found])
        misfit = float(np.mean([one.misfit_ratio for one in found]))
        yield Figure(f"sheets, {name}: weighted squares per degree of freedom, mean of the draws", misfit)


def _covered(
    name: str, truth: np.ndarray, values: Sequence[np.ndarray], covariances: Sequence[np.ndarray]
) -> Iterator[Figure]:
    """Shares of intervals that hold the truth, by constant."""
    sigma = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    inside = np.mean(np.abs(np.array(values) - truth) <= norm.ppf(0.975) * sigma, axis=0)
    for one, share in zip(MODELS[name].constants, inside, strict=True):
        yield Figure(f"sheets, {name}: coverage of 95 % of {one.name}, {len(values)} draws", 100 * share, unit="%")
    worst = 100 * float(np.abs(inside - 0.95).max())
    yield Figure(f"sheets, {name}: coverage of 95 %, largest difference over its constants", worst, 3.0, unit="%")


def _exact(name: str, shape: str) -> Sheet:
    """A sheet at five loads, at the Gauss points of the cells of a lattice."""
    width, length, mode, most = SHAPES[shape]
    lines = tuple(np.linspace(0.0, side, round(side / _CELL_MM) + 1) for side in (width, length))
    stretches = principal_stretches(mode, np.linspace(1.0, most, 6)[1:])
    forces = width * nominal_stress(MODELS[name], np.array(CONSTANTS[name]), stretches)
    solved = equilibrium(MODELS[name], np.array(CONSTANTS[name]), lines, forces)
    return Sheet(
        solved.places, solved.areas, solved.gradients, solved.forces * 0.21, width, length, 0.21,
        u_gradient=np.linspace(*_U_GRADIENT[shape], 6)[1:], shared=4.0 * GAUGE_POINTS,
        u_force=_U_FORCE, u_thickness=_U_THICKNESS,
    )  # fmt: skip


def _drawn(sheet: Sheet, thickness: float, rng: np.random.Generator) -> Sheet:
    """The sheet with noise, of another thickness than is stated."""
    u = np.asarray(sheet.u_gradient)
    steps = window_noise(len(u) + 1, round(sheet.length / _CELL_MM), round(sheet.width / _CELL_MM), rng)
    first = u.min() / np.sqrt(2.0)
    by_step = first * steps[0] + np.sqrt(u**2 - first**2)[:, None, None, None, None] * steps[1:]
    noise = np.repeat(by_step.reshape(len(u), -1, 2, 2), 4, axis=1)
    forces = sheet.forces * thickness + _U_FORCE * rng.standard_normal(len(sheet.forces))
    return sheet._replace(gradients=sheet.gradients + noise, forces=forces)


def window_noise(count: int, rows: int, cols: int, rng: np.random.Generator) -> np.ndarray:
    """Noise (count, row, col, 2, 2) of gradients whose mean square is 1."""
    return _slopes(count, rows, cols, rng) / _size(rows, cols)


@cache
def _size(rows: int, cols: int) -> float:
    return float(np.sqrt(np.mean(_slopes(1000, rows, cols, np.random.default_rng(0)) ** 2)))


def _slopes(count: int, rows: int, cols: int, rng: np.random.Generator) -> np.ndarray:
    """Slopes (count, row, col, 2, 2) of straight lines through displacements of subsets that overlap.

    Windows are cut at the sides, but not at the ends, where rows whose window is cut are left out.
    """
    beyond = _WINDOW // 2
    white = rng.standard_normal((count, rows + 2 * beyond + _SUBSET - 1, cols + _SUBSET - 1, 2))
    moved = sliding_window_view(white, (_SUBSET, _SUBSET), axis=(1, 2)).mean(axis=(-1, -2))
    (slope_x, mean_x), (slope_y, mean_y) = _lines(cols), _lines(rows + 2 * beyond)
    by_x = np.einsum("ij,sjlc,kl->sikc", mean_y, moved, slope_x, optimize=True)
    by_y = np.einsum("ij,sjlc,kl->sikc", slope_y, moved, mean_x, optimize=True)
    return np.stack([by_x, by_y], axis=-1)[:, beyond : rows + beyond]


def _lines(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (count, count) of the slope and the mean in windows that are cut at both ends."""
    slope, mean = np.zeros((2, count, count))
    for middle in range(count):
        inside = np.arange(max(0, middle - _WINDOW // 2), min(count, middle + _WINDOW // 2 + 1))
        away = inside - inside.mean()
        slope[middle, inside], mean[middle, inside] = away / (away @ away), 1.0 / len(inside)
    return slope, mean


PARTS: Mapping[str, Callable[[], Iterator[Figure]]] = {
    "half": half,
    "whole": whole,
    "cycle": hysteresis,
    "coverage": coverage,
}

if __name__ == "__main__":
    if unknown := [name for name in sys.argv[1:] if name not in PARTS]:
        sys.exit(f"no part '{unknown[0]}'; parts: {', '.join(PARTS)}")
    sys.exit(report(sheets(sys.argv[1:])))
