"""Constants of hyperelastic models from curves of stress and stretch, and what they are worth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from dicflow.engine.node import At, Node, Port, Scope, parameter
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.kinds.curve import StressCurve
from dicflow.kinds.material import FittedConstant, FittedCurve, FittedModel, Material
from dicflow.stages._verdict import simplest, verdict

if TYPE_CHECKING:
    from dicflow.core.material.fit import Curve, Fit
    from dicflow.core.material.models import Model

__all__ = ["Hyperelastic", "fitted_model", "rank", "sentence"]

ModelName = Literal["neo_hooke", "mooney_rivlin", "yeoh", "ogden_1", "ogden_2", "ogden_3", "gent", "arruda_boyce"]
_ALL: tuple[ModelName, ...] = (
    "neo_hooke", "mooney_rivlin", "yeoh", "ogden_1", "ogden_2", "ogden_3", "gent", "arruda_boyce"
)  # fmt: skip
_PHASES = {"loading": "loading", "unloading": "unloading", "both": None}


class Hyperelastic(Node):
    """Fit models of rubber to the curves of one or several tests together.

    Points are weighted by the independent share of their uncertainty in stress and stretch, or by their stress where
    that is unknown. Each model gets its constants with intervals of 95 %, their covariance and correlation, the
    condition of the fit, the criterion AICc, the stretches at which it is unstable, and the initial moduli; stable
    models come first, then by AICc. With several tests each one is left out in turn and predicted from the others. The
    verdict says in words what the tests cannot tell: a good fit to one mode says little about others.
    """

    title: ClassVar = "fit hyperelastic models"
    scope: ClassVar = Scope.TEST
    takes: ClassVar = {"curves": Port("curve", at=At.ALL, several=True)}
    gives: ClassVar = "material"
    impl_version: ClassVar = 2

    stage: Literal["hyperelastic"] = "hyperelastic"
    models: Annotated[tuple[ModelName, ...], Field(min_length=1)] = parameter(_ALL, "models to fit")
    phase: Literal["loading", "unloading", "both"] = parameter("loading", "part of the cycle that is fitted")
    stretch: tuple[float, float] = parameter((0.0, 1000.0), "least and largest stretch that is fitted")

    @model_validator(mode="after")
    def _range(self) -> Hyperelastic:
        if not 0.0 <= self.stretch[0] < self.stretch[1]:
            raise ValueError("stretch: write the least stretch, then the largest")
        return self

    def run(self, curves: Sequence[Product]) -> Product:
        from dicflow.core.material.models import MODELS

        names = tuple(getattr(curves, "steps", map(str, range(1, len(curves) + 1))))
        chosen = [self._curve(name, StressCurve.read(curve)) for name, curve in zip(names, curves, strict=True)]
        fitted: list[FittedModel] = []
        refused: dict[str, str] = {}
        for name in dict.fromkeys(self.models):
            try:
                fitted.append(fitted_model(name, MODELS[name], chosen))
            except ValueError as error:
                refused[name] = str(error)
        if not fitted:
            raise StageError(
                f"no model can be fitted, {simplest(refused)}; give more points or a model with fewer constants"
            )
        fitted.sort(key=rank)
        listed = [FittedCurve(one.name, one.mode, len(one.stress), one.common_stress) for one in chosen]
        sentences, warnings = verdict(fitted, listed, refused, chosen)
        facts = {"summary": _summary(fitted), "warnings": warnings}
        return Material.write(listed, _points(chosen, fitted), fitted, refused, sentences, facts)

    def _curve(self, name: str, found: StressCurve) -> Curve:
        """The points of one test that are fitted. Raises StageError if there are none."""
        from dicflow.core.material.fit import Curve
        from dicflow.core.material.modes import principal_stretches

        points = found.points(_PHASES[self.phase], *self.stretch)
        if not len(points.stretch):
            least, most = self.stretch
            raise StageError(
                f"{name} has no point of phase {self.phase} with a stretch from {least:g} to {most:g}; set phase or "
                "stretch otherwise, or leave it out of curves"
            )
        stretches = principal_stretches(found.mode, points.stretch, points.lateral)
        return Curve(name, found.mode, stretches, points.stress, points.u_stress, points.u_stretch, *found.common)


def rank(model: FittedModel) -> tuple[bool, float, float]:
    """Stable models first, by AICc, and by their residuals where that is unknown."""
    return bool(model.unstable), math.inf if model.aicc is None else model.aicc, model.rms_all


def fitted_model(name: str, model: Model, curves: Sequence[Curve]) -> FittedModel:
    """One model with all that is known of its fit. Raises ValueError with too few points."""
    import numpy as np

    from dicflow.core.material.fit import fit, relative_errors
    from dicflow.core.material.prediction import leave_one_out, shear_gradient, stable_within, unsure_pairs

    found = fit(model, curves)
    rms = relative_errors(found.errors, curves)
    counts = np.array([len(curve.stress) for curve in curves])
    left_out = leave_one_out(model, curves) if len(curves) > 1 else [math.nan] * len(curves)
    shear = model.shear_modulus(found.constants)
    half = float(found.half_width_of(shear_gradient(model, found.constants)))
    return FittedModel(
        name=name,
        title=model.title,
        formula=model.formula,
        constants=list(_constants(model, found)),
        covariance=found.covariance.tolist(),
        correlation=np.nan_to_num(found.correlation).tolist(),
        condition=found.condition,
        aicc=_known(found.aicc),
        rms=rms,
        left_out=[_known(one) for one in left_out],
        rms_all=float(np.sqrt(counts @ np.square(rms) / counts.sum())),
        scatter=found.scatter,
        misfit_ratio=_known(found.misfit_ratio),
        freedom=int(counts.sum()) - len(found.constants),
        shear_modulus=(shear, half),
        young_modulus=(3.0 * shear, 3.0 * half),
        unstable=stable_within(model, found.constants, curves),
        unsure=unsure_pairs(model, found.correlation),
        others=found.others.tolist(),
    )


def _known(value: float) -> float | None:
    """The value; None if it is not finite, which JSON lacks."""
    return value if math.isfinite(value) else None


def _constants(model: Model, found: Fit) -> list[FittedConstant]:
    import numpy as np

    independent, common = (np.sqrt(np.diag(one)) for one in (found.independent, found.common))
    return [
        FittedConstant(
            constant.name,
            "MPa" if constant.is_stress else "1",
            float(found.constants[index]),
            float(independent[index]),
            float(common[index]),
            float(found.half_width[index]),
            bool(found.at_limit[index]),
        )
        for index, constant in enumerate(model.constants)
    ]


def _points(curves: Sequence[Curve], fitted: Sequence[FittedModel]) -> dict[str, Variable]:
    """The points that were fitted and what the models make of them, (point,) each."""
    import numpy as np

    from dicflow.core.material.models import MODELS
    from dicflow.core.material.response import nominal_stress

    stretches = np.concatenate([curve.stretches for curve in curves])
    index = np.repeat(np.arange(len(curves)), [len(curve.stress) for curve in curves])
    arrays = {
        "curve": Variable(("point",), index, "1", "number of the curve"),
        "stretch": Variable(("point",), stretches[:, 0], "1", "stretch along the load"),
        "lateral_stretch": Variable(("point",), stretches[:, 1], "1", "stretch across the load"),
        "nominal_stress": Variable(("point",), np.concatenate([curve.stress for curve in curves]), "MPa", "measured"),
    }
    for name in ("u_stress", "u_stretch"):
        values = [_or_unknown(getattr(curve, name), curve.stress) for curve in curves]
        arrays[name] = Variable(("point",), np.concatenate(values), "1" if name == "u_stretch" else "MPa", name)
    for model in fitted:
        stress = nominal_stress(MODELS[model.name], np.array(model.values), stretches)
        arrays[f"stress_{model.name}"] = Variable(("point",), stress, "MPa", f"nominal stress of {model.title}")
    return arrays


def _or_unknown(values: Any, like: Any) -> Any:
    import numpy as np

    return np.full(len(like), np.nan) if values is None else values


def _summary(fitted: Sequence[FittedModel]) -> Mapping[str, float]:
    """Constants of the best model, its moduli, and its residuals; residuals of all models."""
    best = fitted[0]
    summary = {f"{best.name}_{one.name}" + ("_MPa" if one.unit == "MPa" else ""): one.value for one in best.constants}
    summary["shear_modulus_MPa"], summary["young_modulus_MPa"] = best.shear_modulus[0], best.young_modulus[0]
    return summary | {f"rms_{model.name}_pct": 100.0 * model.rms_all for model in fitted}


def sentence(stage: Hyperelastic, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    text = "Hyperelastic models were fitted to nominal stress by weighted least squares [ogden2004]"
    text += " and compared by Akaike's corrected criterion [hurvich1989]"
    if product is None:
        return f"{text}."
    found = Material.read(product)
    best = found.models[0]
    return (
        f"{text}; {best.title} describes the {len(found.curves)} tests best, within {100 * best.rms_all:.1f} % (rms)."
    )
