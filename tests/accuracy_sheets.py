"""A rubber from photographs of three sheets: force balance, constants, predictions, intervals and verdicts.

Run it with ``python -m tests.accuracy_sheets``, or as part of ``make accuracy``.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import convolve1d, uniform_filter
from scipy.stats import norm

from dicflow.core.material.models import MODELS
from dicflow.core.material.modes import principal_stretches
from dicflow.core.material.response import nominal_stress
from dicflow.core.material.virtual_fields import Sheet, constants_of, piecewise_fields
from dicflow.kinds.curve import StressCurve
from dicflow.kinds.material import FittedModel, Material
from dicflow.pipeline import Result
from dicflow.stages.virtual_fields import VirtualFields
from dicflow.synth.equilibrium import equilibrium
from dicflow.synth.sheets import CONSTANTS, GRAVITY, SHAPES, Rubber, loads_of, softened, write_sheets
from tests.bars import Figure
from tests.figures import made, pipeline_result, run_text

__all__ = ["sheets"]

MADE = tuple(Rubber(model, CONSTANTS[model]) for model in ("mooney_rivlin", "yeoh", "ogden_2"))
"""Rubbers that are photographed whole."""
DRAWN = tuple(
    Rubber(model, CONSTANTS[model], seed=seed)
    for seed, model in enumerate(("mooney_rivlin", "yeoh", "ogden_2", "mooney_rivlin", "yeoh", "ogden_2"), start=1)
)
"""Rubbers photographed at half the size: each seed has another thickness, other weights, speckles and noise."""
_MESHES = ((1, 1), (1, 2), (1, 6), (2, 2), (2, 4), (3, 3), (4, 4))
"""Cells of the virtual displacements across and along the load."""
_EQUIBIAXIAL = 1.6
"""Largest stretch of a prediction that stays within the I1 that the sheets reach."""


def sheets() -> Iterator[Figure]:
    """All that is measured from photographs, then the coverage over many draws of fields."""
    inside: list[bool] = []
    for rubber in DRAWN:
        yield from _figures(rubber, _measured(rubber, 0.5), inside)
    for rubber in MADE:
        yield from _figures(rubber, _measured(rubber), inside)
    yield Figure(
        "sheets: constants whose interval of 95 % holds the truth, of those photographed",
        100 * float(np.mean(inside)),
        90.0,
        at_least=True,
        unit="%",
    )
    yield from hysteresis()
    yield from coverage()


def _measured(rubber: Rubber, scale: float = 1.0) -> Result:
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
    if MODELS[rubber.model].is_linear:
        errors = 100 * np.abs(values / np.array(scale)[index] / truth - 1.0)
        for one, error in zip(MODELS[rubber.model].constants, errors, strict=True):
            yield Figure(f"{title}: error of {one.name}", float(error), 1.0, unit="%")
    for mode, error in _stress_errors(model, rubber, float(found["stretch"].max())).items():
        yield Figure(f"{title}: largest error of the stress, {mode}", error, 1.0, unit="%")
    yield from _verdicts(title, rubber, result)
    if MODELS[rubber.model].is_linear:
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
    """What verdicts leave open. The field between the grips of one strip may hold enough; then it must predict."""
    alone, joint = (Material.read(result.product(name)) for name in ("strips_alone", "material"))
    for part, one in (("the strip alone", alone), ("all three shapes", joint)):
        print(f"\n{title}, {part}", *one.verdict, sep="\n  ")
    is_open = [any("cannot tell which holds" in text for text in one.verdict) for one in (alone, joint)]
    yield Figure(f"{title}: three shapes leave no model open", float(not is_open[1]), 1.0, at_least=True)
    yield Figure(f"{title}: the strip alone leaves the model open", float(is_open[0]))
    if not is_open[0]:
        error = max(_stress_errors(alone.models[0], rubber, float(alone["stretch"].max())).values())
        yield Figure(
            f"{title}: the strip alone, which leaves none open: largest error of the stress", error, 10.0, unit="%"
        )


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
"""Draws; side of the cells between points; side of windows and of subsets in points, as in the photographs."""
_U_FORCE, _U_THICKNESS, _NOISE = 0.1 * 9.80665e-3, 0.024, 5e-4


def coverage() -> Iterator[Figure]:
    """Draws of the exact fields with noise as that of windows over subsets: intervals, and how often they hold."""
    for name in ("mooney_rivlin", "yeoh"):
        truth = np.array(CONSTANTS[name])
        exact = [_exact(name, shape) for shape in ("strip", "square", "wide")]
        fields = [piecewise_fields(one, np.array([0.0, one.width]), np.linspace(0.0, one.length, 3)) for one in exact]
        rng, inside = np.random.default_rng(23), []
        shares = rng.permutation(norm.ppf((np.arange(_DRAWS) + 0.5) / _DRAWS))
        for share in shares:
            drawn = [_drawn(one, 1.0 + _U_THICKNESS * share, rng) for one in exact]
            found = constants_of(MODELS[name], drawn, fields, truth)
            inside.append(np.abs(found.constants - truth) <= 1.96 * np.sqrt(np.diag(found.covariance)))
        print(f"\ncoverage, {name}: {100 * np.mean(inside, axis=0)} % of {_DRAWS} draws")
        worst = 100 * float(np.abs(np.mean(inside, axis=0) - 0.95).max())
        yield Figure(f"sheets, {name}: coverage of 95 %, largest difference over its constants", worst, 3.0, unit="%")


def _exact(name: str, shape: str) -> Sheet:
    """A sheet at five loads, at the middles of the cells of a lattice."""
    width, length, mode, most = SHAPES[shape]
    lines = tuple(np.linspace(0.0, side, round(side / _CELL_MM) + 1) for side in (width, length))
    stretches = principal_stretches(mode, np.linspace(1.0, most, 6)[1:])
    forces = width * nominal_stress(MODELS[name], np.array(CONSTANTS[name]), stretches)
    solved = equilibrium(MODELS[name], np.array(CONSTANTS[name]), lines, forces)
    return Sheet(
        solved.places, solved.areas, solved.gradients, solved.forces * 0.21, width, length, 0.21,
        u_gradient=_NOISE, shared=4.0 * _WINDOW**2, u_force=_U_FORCE, u_thickness=_U_THICKNESS,
    )  # fmt: skip


def _drawn(sheet: Sheet, thickness: float, rng: np.random.Generator) -> Sheet:
    """The sheet with noise, of another thickness than is stated."""
    rows, cols = round(sheet.length / _CELL_MM), round(sheet.width / _CELL_MM)
    first = _noise((rows, cols), rng)
    noise = [
        np.repeat((first + _noise((rows, cols), rng)).reshape(-1, 2, 2) / np.sqrt(2.0), 4, axis=0) for _ in sheet.forces
    ]
    forces = sheet.forces * thickness + _U_FORCE * rng.standard_normal(len(sheet.forces))
    return sheet._replace(gradients=sheet.gradients + np.array(noise), forces=forces)


def _noise(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Noise (row, col, 2, 2) of gradients from straight lines through displacements whose subsets overlap."""
    moved = uniform_filter(rng.standard_normal((*shape, 2)), (_SUBSET, _SUBSET, 1), mode="nearest")
    slope = np.arange(_WINDOW) - (_WINDOW - 1) / 2.0
    along = [
        uniform_filter(convolve1d(moved, -slope, axis=axis, mode="nearest"), _window(axis), mode="nearest")
        for axis in (1, 0)
    ]
    found = np.stack(along, axis=-1)
    return np.asarray(found * _NOISE / found.std())


def _window(axis: int) -> tuple[int, int, int]:
    return (_WINDOW, 1, 1) if axis == 1 else (1, _WINDOW, 1)


if __name__ == "__main__":
    import sys

    from tests.figures import report

    sys.exit(report(sheets()))
