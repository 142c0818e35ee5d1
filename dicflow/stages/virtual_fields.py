"""Constants of models from the whole fields of thin specimens, by virtual work, and a check of their forces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from dicflow.engine.node import At, Node, Port, Scope, parameter
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.kinds.material import FittedConstant, FittedCurve, FittedModel, Material
from dicflow.kinds.sheet import SheetFields
from dicflow.stages._verdict import simplest, verdict

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.material.fit import Curve
    from dicflow.core.material.models import Model
    from dicflow.core.material.virtual_fields import FieldFit, Sheet, VirtualField

__all__ = ["VirtualFields", "sentence"]

ModelName = Literal["neo_hooke", "mooney_rivlin", "yeoh", "ogden_1", "ogden_2", "gent", "arruda_boyce"]
_DEFAULT: tuple[ModelName, ...] = ("neo_hooke", "mooney_rivlin", "yeoh", "ogden_2")
Cells = Annotated[int, Field(ge=1, le=20)]
_NORMAL = 1.96
_SMALL = 0.1
"""Strain up to which the force balance is not judged."""
_UNBALANCED = 0.05
"""Difference of the forces from which it warns."""


class VirtualFields(Node):
    """Fit models to the deformation gradients of all points and steps of one or several sheets, by virtual work.

    For virtual displacements on a coarse mesh, which move the last row of points as a whole and leave the first at
    rest, the work of the stresses is that of the load: one equation each at every step. They are weighted by the noise
    that their points share. The mean stress along the load times the section is the load, also where the section is not
    uniform: the **force balance**. With several sheets each one is left out in turn, and its loads are predicted.
    """

    title: ClassVar = "constants from the whole field"
    scope: ClassVar = Scope.TEST
    takes: ClassVar = {"sheets": Port("sheet", at=At.ALL, several=True)}
    gives: ClassVar = "material"
    impl_version: ClassVar = 4

    stage: Literal["virtual_fields"] = "virtual_fields"
    models: Annotated[tuple[ModelName, ...], Field(min_length=1)] = parameter(_DEFAULT, "models to fit")
    mesh: tuple[Cells, Cells] = parameter((1, 3), "cells of the virtual mesh, across and along the load, at most")

    def run(self, sheets: Sequence[Product]) -> Product:
        from dicflow.core.material.models import MODELS

        names = tuple(getattr(sheets, "steps", map(str, range(1, len(sheets) + 1))))
        read = [SheetFields.read(one) for one in sheets]
        prepared = [_sheet(one) for one in read]
        test = _Test(
            prepared,
            [_virtual(sheet, one, self.mesh) for sheet, one in zip(prepared, read, strict=True)],
            [_mean_curve(*pair) for pair in zip(names, prepared, strict=True)],
        )
        fitted: dict[str, tuple[FittedModel, list[np.ndarray]]] = {}
        refused: dict[str, str] = {}
        for name in dict.fromkeys(self.models):
            try:
                fitted[name] = test.fitted(name, MODELS[name])
            except ValueError as error:
                refused[name] = str(error)
        if not fitted:
            raise StageError(
                f"no model can be fitted, {simplest(refused)}; give more loaded steps or a model with fewer constants"
            )
        models = sorted((model for model, _ in fitted.values()), key=_rank)
        listed = [FittedCurve(one.name, "biaxial", len(one.stress), one.common_stress) for one in test.curves]
        ratios = {model.name: fitted[model.name][1] for model in models}
        sentences, warnings = verdict(models, listed, refused, test.curves)
        text, warns = _balance(models[0], ratios[models[0].name], test.curves)
        facts = {
            "summary": _summary(models[0], ratios[models[0].name]),
            "warnings": [*([text.rstrip(".")] if warns else []), *warnings],
        }
        return Material.write(listed, _points(test.curves, ratios), models, refused, [*sentences, text], facts)


class _Test:
    """Sheets with their virtual fields, and as curves of mean stretches."""

    def __init__(
        self, sheets: Sequence[Sheet], fields: Sequence[Sequence[VirtualField]], curves: Sequence[Curve]
    ) -> None:
        self.sheets, self.fields, self.curves = sheets, fields, curves

    def fitted(self, name: str, model: Model) -> tuple[FittedModel, list[np.ndarray]]:
        """The model fitted to all sheets, and for each the load that its mean stress carries over the measured one.

        Raises ValueError with too few steps.
        """
        import numpy as np

        from dicflow.core.material.fit import fit
        from dicflow.core.material.prediction import shear_gradient, stable_within, unsure_pairs

        found = self._constants(model, fit(model, self.curves).constants)
        c, ratios = found.constants, [self._ratio(model, found.constants, k) for k in range(len(self.sheets))]
        shear, slope = model.shear_modulus(c), shear_gradient(model, c)
        half = _NORMAL * math.sqrt(max(0.0, float(slope @ found.covariance @ slope)))
        fitted = FittedModel(
            name=name,
            title=model.title,
            formula=model.formula,
            constants=list(_constants(model, found)),
            covariance=found.covariance.tolist(),
            correlation=found.correlation.tolist(),
            condition=float(np.sqrt(np.linalg.cond(found.independent / np.outer(c, c)))),
            aicc=found.aicc,
            rms=[_rms(ratio) for ratio in ratios],
            left_out=self._left_out(model, c),
            rms_all=_rms(np.concatenate(ratios)),
            scatter=0.0,
            misfit_ratio=found.misfit_ratio if all(np.all(one.u_gradient) for one in self.sheets) else None,
            freedom=found.equations - len(c),
            shear_modulus=(shear, half),
            young_modulus=(3.0 * shear, 3.0 * half),
            unstable=stable_within(model, c, self.curves),
            unsure=unsure_pairs(model, found.correlation),
            others=[],
        )
        return fitted, ratios

    def _constants(self, model: Model, start: np.ndarray, without: int = -1) -> FieldFit:
        """Constants from all sheets but one."""
        from dicflow.core.material.virtual_fields import constants_of

        used = [k for k in range(len(self.sheets)) if k != without]
        return constants_of(model, [self.sheets[k] for k in used], [self.fields[k] for k in used], start)

    def _ratio(self, model: Model, c: np.ndarray, index: int) -> np.ndarray:
        from dicflow.core.material.virtual_fields import balance

        return balance(model, c, self.sheets[index])

    def _left_out(self, model: Model, start: np.ndarray) -> list[float | None]:
        """Error by which the other sheets predict the loads of each; None where they are too few."""
        found: list[float | None] = []
        for index in range(len(self.sheets)):
            try:
                c = self._constants(model, start, index).constants
                found.append(_rms(self._ratio(model, c, index)))
            except ValueError:
                found.append(None)
        return found


def _rank(model: FittedModel) -> tuple[bool, float]:
    """Stable models first, by AICc."""
    return bool(model.unstable), math.inf if model.aicc is None else model.aicc


def _rms(ratio: np.ndarray) -> float:
    import numpy as np

    return float(np.sqrt(np.mean((ratio - 1.0) ** 2)))


def _sheet(fields: SheetFields) -> Sheet:
    from dicflow.core.material.virtual_fields import Sheet

    facts = fields.facts
    return Sheet(
        places=fields["places"],
        areas=fields["areas"],
        gradients=fields["gradients"],
        forces=fields["forces"],
        width=facts.width,
        length=facts.length,
        thickness=facts.thickness,
        u_gradient=fields["u_gradient"],
        u_bias=fields["u_bias"],
        shared=facts.shared,
        u_force=facts.u_force,
        u_thickness=facts.u_thickness / facts.thickness,
        u_width=facts.u_width / facts.width,
        slopes=fields["slopes"],
    )


def _virtual(sheet: Sheet, fields: SheetFields, mesh: tuple[int, int]) -> list[VirtualField]:
    """Virtual fields on a mesh whose lines along the load lie between rows of points.

    There are fewer cells where rows lack, and none is smaller than the noise can tell: finer fields see only the errors
    of the sums over few points.
    """
    import numpy as np

    from dicflow.core.material.virtual_fields import piecewise_fields

    lines, count = fields["lines"], len(fields["lines"]) - 1
    across, along = (
        max(1, min(wanted, int(side / sheet.noise_width)))
        for wanted, side in zip(mesh, (sheet.width, sheet.length), strict=True)
    )
    chosen = np.unique(np.round(np.linspace(0, count, min(along, count) + 1)).astype(int))
    return piecewise_fields(sheet, np.linspace(0.0, sheet.width, across + 1), lines[chosen])


def _mean_curve(name: str, sheet: Sheet) -> Curve:
    """Mean stretches of a sheet over nominal stress, as a test whose stretch across the load is measured."""
    import numpy as np

    from dicflow.core.material.fit import Curve
    from dicflow.core.material.modes import principal_stretches

    fibres = np.average(np.linalg.norm(sheet.gradients, axis=-2), axis=1, weights=sheet.areas)
    stretches, section = principal_stretches("biaxial", fibres[:, 1], fibres[:, 0]), sheet.width * sheet.thickness
    u_stress = np.full(len(sheet.forces), max(sheet.u_force / section, 1e-9))
    u_stretch = np.sqrt(sheet.shared / len(sheet.areas)) * np.broadcast_to(sheet.u_gradient, len(sheet.forces))
    common = math.hypot(sheet.u_thickness, sheet.u_width)
    return Curve(name, "biaxial", stretches, sheet.forces / section, u_stress, u_stretch, common)


def _constants(model: Model, found: FieldFit) -> Iterator[FittedConstant]:
    for index, one in enumerate(model.constants):
        independent, common = (math.sqrt(float(part[index, index])) for part in (found.independent, found.common))
        half = _NORMAL * math.hypot(independent, common)
        unit = "MPa" if one.is_stress else "1"
        yield FittedConstant(one.name, unit, float(found.constants[index]), independent, common, half, False)


def _balance(model: FittedModel, ratios: Sequence[np.ndarray], curves: Sequence[Curve]) -> tuple[str, bool]:
    """How well forces balance, and whether this warns."""
    import numpy as np

    values = ", ".join(f"{one.name} = {one.value:.4g} ± {one.half_width:.2g}" for one in model.constants)
    values = values.replace("= -", "= −")
    text = f"{model.title} by virtual fields: {values} (95 %)"
    large = [
        np.abs(ratio - 1.0)[curve.stretches[:, 0] > 1.0 + _SMALL] for ratio, curve in zip(ratios, curves, strict=True)
    ]
    worst = float(np.concatenate(large).max(initial=0.0))
    if not any(map(len, large)):
        return f"{text}.", False
    return (
        f"{text}; the mean stress carries the load within {100 * worst:.2g} % above 10 % strain.",
        worst > _UNBALANCED,
    )


def _summary(model: FittedModel, ratios: Sequence[np.ndarray]) -> dict[str, float]:
    import numpy as np

    summary = {f"{model.name}_{one.name}" + ("_MPa" if one.unit == "MPa" else ""): one.value for one in model.constants}
    return {**summary, "largest_imbalance_pct": 100.0 * float(np.abs(np.concatenate(ratios) - 1.0).max())}


def _points(curves: Sequence[Curve], ratios: dict[str, list[np.ndarray]]) -> dict[str, Variable]:
    """Mean stretches and stresses of the loaded steps, (point,), with what the models make of them."""
    import numpy as np

    def joined(name: str) -> np.ndarray:
        return np.concatenate([getattr(curve, name) for curve in curves])

    counts, stress = [len(curve.stress) for curve in curves], joined("stress")
    best = np.concatenate(next(iter(ratios.values())))
    arrays = {
        "curve": (np.repeat(np.arange(len(curves)), counts), "1", "number of the curve"),
        "stretch": (joined("stretches")[:, 0], "1", "mean stretch along the load"),
        "lateral_stretch": (joined("stretches")[:, 1], "1", "mean stretch across the load"),
        "nominal_stress": (stress, "MPa", "load per first section"),
        "u_stress": (joined("u_stress"), "MPa", "u_stress"),
        "u_stretch": (joined("u_stretch"), "1", "u_stretch"),
        "force_balance": (best, "1", "load that the mean stress of the best model carries over the measured one"),
    }
    for name, found in ratios.items():
        arrays[f"stress_{name}"] = (stress * np.concatenate(found), "MPa", f"mean nominal stress of {name}")
    return {key: Variable(("point",), values, unit, title) for key, (values, unit, title) in arrays.items()}


def sentence(stage: VirtualFields, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    across, along = stage.mesh
    return (
        f"The constants of hyperelastic models were identified from the deformation gradients of all points by the "
        f"virtual fields method [pierron2012], with piecewise virtual fields on {across} × {along} cells."
    )
