"""Constants of a model from the whole field of a thin specimen, by virtual work, and a check of its forces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, NamedTuple

from pydantic import Field

from dicflow.engine.node import At, Millimetres, Node, Port, Scope, parameter
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.kinds.channels import Channels
from dicflow.kinds.material import FittedConstant, FittedCurve, FittedModel, Material
from dicflow.kinds.total import Total

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.material.fit import Curve
    from dicflow.core.material.models import Model
    from dicflow.core.material.virtual_fields import FieldFit, Sheet

__all__ = ["VirtualFields", "sentence"]

Cells = Annotated[int, Field(ge=1, le=20)]
_FEW = 0.9
"""Share of the points of the rectangle around the field that should be known at all steps."""
_RIM = 0.1
"""Share of the width without points from which a warning is due."""
_NORMAL = 1.96
_SMALL = 0.1
"""Strain up to which the force balance is not judged."""


class _Rim(NamedTuple):
    """How much of the specimen the points show: shares of its width, and of the rectangle around them."""

    width: float
    points: float


class VirtualFields(Node):
    """Fit one model to the deformation gradients of all points and steps, by virtual work.

    The specimen is a thin sheet of rubber whose sides are free, pulled along the y of the photographs. For virtual
    displacements on a coarse mesh, which move the last row of points as a whole and leave the first at rest, the work
    of the stresses is that of the load: one equation each at every step. They are weighted by the noise that their
    points share. The mean stress along the load times the section is the load, also where the section is not uniform:
    the **force balance**.

    Points lost at some step are left out of all; where the points do not reach the sides of the specimen, its rim is
    taken to carry as much as the others.
    """

    title: ClassVar = "constants from the whole field"
    scope: ClassVar = Scope.TEST
    takes: ClassVar = {"total": Port("total", at=At.ALL), "channels": Port("channels")}
    gives: ClassVar = "material"

    stage: Literal["virtual_fields"] = "virtual_fields"
    model: Literal["neo_hooke", "mooney_rivlin", "yeoh", "ogden_1", "ogden_2", "gent", "arruda_boyce"] = parameter(
        "mooney_rivlin", "model to fit"
    )
    width: Millimetres = parameter(..., "of the unloaded specimen, side to side", unit="mm", gt=0)
    thickness: Millimetres = parameter(..., "of the unloaded specimen", unit="mm", gt=0)
    u_width: Millimetres = parameter(0.0, "standard uncertainty of the width", unit="mm", ge=0)
    u_thickness: Millimetres = parameter(..., "standard uncertainty of the thickness", unit="mm", ge=0)
    mesh: tuple[Cells, Cells] = parameter((2, 3), "cells of the virtual mesh, across and along the load")

    def run(self, total: Sequence[Product], channels: Product) -> Product:
        from dicflow.core.material.models import MODELS
        from dicflow.core.material.virtual_fields import constants_of, piecewise_fields

        steps = tuple(getattr(total, "steps", map(str, range(1, len(total) + 1))))
        sheet, rim = self._sheet([Total.read(one) for one in total], *_forces(Channels.read(channels), steps))
        model, curve = MODELS[self.model], _mean_curve(sheet)
        try:
            start = _start(model, curve)
            lines = [_lines(sheet.places[:, axis], cells) for axis, cells in enumerate(self.mesh)]
            found = constants_of(model, [sheet], [piecewise_fields(sheet, *lines)], start)
        except ValueError as error:
            raise StageError(
                f"{error}; take a finer mesh, more loaded steps, or a model with fewer constants"
            ) from error
        fitted, ratio = _fitted(self.model, model, found, sheet, curve)
        sentences = list(_sentences(fitted, ratio, curve, rim))
        warnings = [text.rstrip(".") for text, warns in sentences if warns]
        listed = [FittedCurve("field", "biaxial", len(sheet.areas), sheet.u_thickness)]
        facts = {"summary": _summary(fitted, ratio), "warnings": warnings}
        points = _points(self.model, curve, ratio)
        return Material.write(listed, points, [fitted], {}, [text for text, _ in sentences], facts)

    def _sheet(self, totals: Sequence[Total], forces: np.ndarray, u_force: float) -> tuple[Sheet, _Rim]:
        """The points known at all loaded steps, with their areas as shares of the whole specimen."""
        import numpy as np

        from dicflow.core.material.virtual_fields import Sheet

        loaded = [
            k for k, total in enumerate(totals) if np.isfinite(forces[k]) and forces[k] > 0 and total.known().any()
        ]
        if not loaded:
            raise StageError("no step has both a load above 0 and measured points; look at the load and the total")
        used = [totals[k] for k in loaded]
        if not used[0].in_space:
            raise StageError("virtual work needs lengths in mm; measure with two cameras")
        known = np.all([total.known() for total in used], axis=0)
        if known.sum() < 4:
            raise StageError(
                "fewer than 4 points are known at all loaded steps; leave steps out, or look at lost points"
            )
        rows, cols = (np.flatnonzero(known.any(axis=axis)) for axis in (1, 0))
        across, along = _spacing(used[0]["xyz_reference"])
        row, col = np.nonzero(known)
        places = np.stack([(col - cols[0] + 0.5) * across, (row - rows[0] + 0.5) * along], axis=-1)
        seen, length = (np.ptp(cols) + 1) * across, (np.ptp(rows) + 1) * along
        if seen > 1.05 * self.width:
            raise StageError(f"the points are {seen:.1f} mm wide, more than the width of {self.width:g} mm; correct it")
        sheet = Sheet(
            places=places * [self.width / seen, 1.0],
            areas=np.full(len(row), self.width * length / len(row)),
            gradients=np.stack([total["gradient"][known] for total in used]),
            forces=forces[loaded],
            width=self.width,
            length=float(length),
            thickness=self.thickness,
            u_gradient=_noise(used, known),
            shared=_shared(used[0]),
            u_force=u_force,
            u_thickness=math.hypot(self.u_thickness / self.thickness, self.u_width / self.width),
        )
        return sheet, _Rim(float(seen / self.width), float(known.sum() / (np.ptp(rows) + 1) / (np.ptp(cols) + 1)))


def _forces(channels: Channels, steps: Sequence[str]) -> tuple[np.ndarray, float]:
    """Load at each step of the total [N], and its standard uncertainty. Raises StageError for one without unit N."""
    import numpy as np

    load = channels.of(channels.load)
    factor = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "g": 9.80665e-3, "kg": 9.80665}.get(load.unit)
    if factor is None:
        raise StageError(f"the load '{channels.load}' has the unit '{load.unit}'; expected N, kN, mN, g or kg")
    if missing := [step for step in steps if step not in channels.steps]:
        raise StageError(f"the channels have no step {', '.join(missing)}; give a load for every step")
    places = [channels.steps.index(step) for step in steps]
    u = 0.0 if load.u is None else float(np.nanmedian(load.u[places]))
    return load.values[places] * factor, u * factor


def _spacing(places: np.ndarray) -> tuple[float, float]:
    """Distance of neighbouring points along a row and along a column [mm]."""
    import numpy as np

    return tuple(float(np.nanmedian(np.linalg.norm(np.diff(places, axis=axis), axis=-1))) for axis in (1, 0))  # type: ignore[return-value]


def _lines(places: np.ndarray, cells: int) -> np.ndarray:
    """Lines of a virtual mesh between the points along one axis, (line,); fewer cells where there are few points."""
    import numpy as np

    known = np.unique(np.round(places, 9))
    spacing = 2.0 * known[0]
    count = round(known[-1] / spacing + 0.5)
    lines: np.ndarray = np.unique(np.round(np.linspace(0, count, min(cells, count) + 1))) * spacing
    return lines


def _noise(totals: Sequence[Total], known: np.ndarray) -> float:
    """Root mean square σ of the strains along both axes; 0 if unknown."""
    import numpy as np

    if not all(total.has_uncertainty for total in totals):
        return 0.0
    squares = [np.square(total.sigma(name)[known]) for total in totals for name in ("exx", "eyy")]
    return float(np.sqrt(np.nanmean(squares)))


def _shared(total: Total) -> float:
    """Number of neighbours whose windows overlap so much that they have one noise."""
    return 1.0 if total.gauge is None else max(1.0, (total.gauge.side_px / total.step_size) ** 2)


def _mean_curve(sheet: Sheet) -> Curve:
    """Mean stretches of the field over nominal stress, as a test whose stretch across the load is measured."""
    import numpy as np

    from dicflow.core.material.fit import Curve
    from dicflow.core.material.modes import principal_stretches

    fibres = np.linalg.norm(sheet.gradients, axis=-2).mean(axis=1)
    stretches = principal_stretches("biaxial", fibres[:, 1], fibres[:, 0])
    return Curve("field", "biaxial", stretches, sheet.forces / (sheet.width * sheet.thickness))


def _start(model: Model, curve: Curve) -> np.ndarray:
    """Constants that describe the mean curve. Raises ValueError with too few steps."""
    from dicflow.core.material.fit import fit

    return fit(model, [curve]).constants


def _fitted(name: str, model: Model, found: FieldFit, sheet: Sheet, curve: Curve) -> tuple[FittedModel, np.ndarray]:
    """The fitted model, and at each step the load that its mean stress carries, relative to the measured one."""
    import numpy as np

    from dicflow.core.material.prediction import shear_gradient, stable_within, unsure_pairs
    from dicflow.core.material.virtual_fields import balance

    c, ratio = found.constants, balance(model, found.constants, sheet)
    rms, shear, slope = float(np.sqrt(np.mean((ratio - 1.0) ** 2))), model.shear_modulus(c), shear_gradient(model, c)
    half = _NORMAL * math.sqrt(max(0.0, float(slope @ found.covariance @ slope)))
    fitted = FittedModel(
        name=name,
        title=model.title,
        formula=model.formula,
        constants=list(_constants(model, found)),
        covariance=found.covariance.tolist(),
        correlation=found.correlation.tolist(),
        condition=float(np.sqrt(np.linalg.cond(found.independent / np.outer(c, c)))),
        aicc=None,
        rms=[rms],
        left_out=[None],
        rms_all=rms,
        scatter=0.0,
        misfit_ratio=None,
        shear_modulus=(shear, half),
        young_modulus=(3.0 * shear, 3.0 * half),
        unstable=stable_within(model, c, [curve]),
        unsure=unsure_pairs(model, found.correlation),
        others=[],
    )
    return fitted, ratio


def _constants(model: Model, found: FieldFit) -> Iterator[FittedConstant]:
    for index, one in enumerate(model.constants):
        independent, common = (math.sqrt(float(part[index, index])) for part in (found.independent, found.common))
        half = _NORMAL * math.hypot(independent, common)
        unit = "MPa" if one.is_stress else "1"
        yield FittedConstant(one.name, unit, float(found.constants[index]), independent, common, half, False)


def _sentences(fitted: FittedModel, ratio: np.ndarray, curve: Curve, rim: _Rim) -> Iterator[tuple[str, bool]]:
    """What the field says, each with whether it warns."""
    import numpy as np

    values = ", ".join(f"{one.name} = {one.value:.4g} ± {one.half_width:.2g}" for one in fitted.constants)
    yield f"{fitted.title} by virtual fields of the whole field: {values} (95 %).", False
    judged = curve.stretches[:, 0] > 1.0 + _SMALL
    if judged.any():
        worst = float(np.abs(ratio[judged] - 1.0).max())
        yield (
            f"The mean stress carries the load within {100 * worst:.2g} % at every step above 10 % strain.",
            worst > 0.05,
        )
    if fitted.unstable:
        where = ", ".join(f"{mode} from {stretch:.2f}" for mode, stretch in fitted.unstable.items())
        yield f"{fitted.title} with these constants is unstable: {where}.", True
    for one, other, rho in fitted.unsure[:1]:
        yield f"This specimen cannot tell {one} from {other} (correlation {rho:+.2f}); add one of another shape.", True
    if rim.width < 1.0 - _RIM:
        yield (
            (f"The points show {100 * rim.width:.0f} % of the width; the rest is taken to carry as much."),
            True,
        )
    if rim.points < _FEW:
        yield (
            f"Only {100 * rim.points:.0f} % of the points are known at all loaded steps; the others are left out.",
            True,
        )


def _summary(fitted: FittedModel, ratio: np.ndarray) -> dict[str, float]:
    import numpy as np

    summary = {one.name + ("_MPa" if one.unit == "MPa" else ""): one.value for one in fitted.constants}
    return {**summary, "largest_imbalance_pct": 100.0 * float(np.abs(ratio - 1.0).max())}


def _points(name: str, curve: Curve, ratio: np.ndarray) -> dict[str, Variable]:
    """Mean stretches and stresses of the loaded steps, (point,), with the force balance."""
    import numpy as np

    unknown = np.full(len(ratio), np.nan)
    arrays = {
        "curve": (np.zeros(len(ratio), np.int64), "1", "number of the curve"),
        "stretch": (curve.stretches[:, 0], "1", "mean stretch along the load"),
        "lateral_stretch": (curve.stretches[:, 1], "1", "mean stretch across the load"),
        "nominal_stress": (curve.stress, "MPa", "load per first section"),
        "u_stress": (unknown, "MPa", "u_stress"),
        "u_stretch": (unknown, "1", "u_stretch"),
        f"stress_{name}": (curve.stress * ratio, "MPa", "mean nominal stress of the model"),
        "force_balance": (ratio, "1", "load that the mean stress carries, relative to the measured one"),
    }
    return {key: Variable(("point",), values, unit, title) for key, (values, unit, title) in arrays.items()}


def sentence(stage: VirtualFields, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    from dicflow.core.material.models import MODELS

    title, (across, along) = MODELS[stage.model].title, stage.mesh
    return (
        f"The constants of {title} were identified from the deformation gradients of all points by the virtual fields "
        f"method [pierron2012], with piecewise virtual fields on {across} × {along} cells."
    )
