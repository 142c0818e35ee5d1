"""A rubber from photographs of three sheets: force balance, constants, predictions, intervals and verdicts.

Run it with ``python -m tests.accuracy_sheets``, or as part of ``make accuracy``.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import convolve1d, uniform_filter
from scipy.stats import norm

from dicflow.core.material.models import MODELS
from dicflow.core.material.modes import principal_stretches
from dicflow.core.material.response import nominal_stress
from dicflow.core.material.virtual_fields import Sheet, constants_of, piecewise_fields
from dicflow.kinds.material import FittedModel, Material
from dicflow.pipeline import Result
from dicflow.synth.equilibrium import equilibrium
from dicflow.synth.sheets import CONSTANTS, SHAPES, Rubber, write_sheets
from tests.bars import Figure
from tests.figures import made, pipeline_result

__all__ = ["sheets"]

MADE = (
    Rubber("mooney_rivlin", CONSTANTS["mooney_rivlin"]),
    Rubber("yeoh", CONSTANTS["yeoh"]),
    Rubber("ogden_2", CONSTANTS["ogden_2"]),
    Rubber("mooney_rivlin", CONSTANTS["mooney_rivlin"], seed=1),
    Rubber("yeoh", CONSTANTS["yeoh"], seed=2),
)
"""Photographed rubbers; each seed has another thickness, other weights, speckles and noise."""
_EQUIBIAXIAL = 1.6
"""Largest stretch of a prediction that stays within the I1 that the sheets reach."""


def sheets() -> Iterator[Figure]:
    """All that is measured from photographs, then the coverage over many draws of fields."""
    inside = []
    for rubber in MADE:
        result = _measured(rubber)
        yield from _figures(rubber, Material.read(result.product("material")), inside)
        if rubber.seed == 0 and rubber.model == "mooney_rivlin":
            yield from _verdicts(result)
    yield Figure(
        "sheets: constants whose interval of 95 % holds the truth, of those photographed",
        100 * float(np.mean(inside)),
        90.0,
        at_least=True,
        unit="%",
    )
    yield from coverage()


def _measured(rubber: Rubber) -> Result:
    name = f"sheets_{rubber.model}_{rubber.seed}"
    return pipeline_result(
        "latex_material", made(name, lambda folder: write_sheets(folder, rubber, workers=2)), f"store_{name}"
    )


def _figures(rubber: Rubber, found: Material, inside: list[bool]) -> Iterator[Figure]:
    """Of one rubber. The stated thickness is wrong, which scales all stresses: this common share is taken out.

    inside : gets whether each interval holds the truth
    """
    title = f"sheets, {rubber.model} {rubber.seed}"
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
    for mode, error in _stress_errors(model, truth, common, float(found["stretch"].max())).items():
        yield Figure(f"{title}: largest error of the stress, {mode}", error, 1.0, unit="%")


def _order(model: FittedModel, truth: np.ndarray) -> np.ndarray:
    """Order of the fitted constants in which they are those of the truth: Ogden's terms have none."""
    if MODELS[model.name].is_linear:
        return np.arange(len(truth))
    terms, wanted = np.argsort(model.values[1::2]), np.argsort(np.argsort(truth[1::2]))
    return (2 * terms[wanted][:, None] + np.arange(2)).ravel()


def _stress_errors(model: FittedModel, truth: np.ndarray, common: float, most: float) -> dict[str, float]:
    """Largest error of the predicted stress by mode, beside the common share [%]."""
    found = {}
    for mode, end in (("uniaxial", most), ("planar", 1.9), ("equibiaxial", _EQUIBIAXIAL)):
        stretches = principal_stretches(mode, np.linspace(1.1, end, 50))
        exact = nominal_stress(MODELS[model.name], truth, stretches)
        fitted = nominal_stress(MODELS[model.name], np.array(model.values), stretches) / common
        found[mode] = 100 * float(np.abs(fitted / exact - 1.0).max())
    return found


def _verdicts(result: Result) -> Iterator[Figure]:
    found = [Material.read(result.product(name)) for name in ("strips_alone", "material")]
    for title, one in zip(("the strip alone", "all three shapes"), found, strict=True):
        print(f"\nsheets, {title}", *one.verdict, sep="\n  ")
    open_questions = [any("cannot tell which holds" in text for text in one.verdict) for one in found]
    yield Figure(
        "sheets: the strip alone cannot tell, three shapes can",
        float(open_questions == [True, False]),
        1.0,
        at_least=True,
    )


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
