"""Bias and scatter of each quantity at steps without deformation."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, Literal

from dicflow.engine.node import At, Joined, Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.kind import steps_of, summary_of
from dicflow.kinds.noise_floor import NoiseFloorTable
from dicflow.kinds.probes import gauge_facts
from dicflow.kinds.quantities import BASIC, QUANTITIES, figure_in_words
from dicflow.kinds.total import Total, named_with_unit
from dicflow.stages._parameters import unknown_steps

if TYPE_CHECKING:
    import numpy as np

__all__ = ["NoiseFloor", "fields_at_rest", "sentence"]

_QUANTITIES = {name: quantity for name, quantity in QUANTITIES.items() if "noise_floor" in quantity.uses}
_FIGURES = ("bias", "sigma", "predicted_sigma")


class NoiseFloor(Node):
    """Bias and standard deviation over the points of displacement and strain, at steps without deformation.

    Bias is the mean over the points, σ their scatter about it, beside the σ that was predicted (its root mean square).
    At a rigidly moved step the best rigid-body motion is removed from the displacement first; the scatter of the
    displacement is then that about the motion. Noise alone separates the principal strains, which gives them a bias of
    about σ at zero strain.
    """

    title: ClassVar = "noise floor"
    scope: ClassVar = Scope.TEST
    takes: ClassVar = {"total": Port("total", at=At.ALL)}
    gives: ClassVar = "noise"
    impl_version: ClassVar = 2

    stage: Literal["noise_floor"] = "noise_floor"
    still: tuple[str, ...] = parameter((), "names of the static or rigidly moved steps; all if none is named")
    rigid: bool = parameter(True, "remove the rigid-body motion of each step first")

    def problems(self, joined: Mapping[str, Joined]) -> Iterator[tuple[str, str]]:
        return unknown_steps("still", self.still, joined["total"])

    def run(self, total: Sequence[Product]) -> Product:
        import numpy as np

        names: tuple[str, ...] = tuple(getattr(total, "steps", map(str, range(1, len(total) + 1))))
        if unknown := [name for name in self.still if name not in names]:
            raise StageError(f"no step {', '.join(unknown)} after the first; the steps are {', '.join(names)}")
        chosen = [name for name in names if not self.still or name in self.still]
        if not chosen:
            raise StageError("a noise floor needs a second step; give another photograph of the unmoved specimen")
        found = [self._floor(Total.read(total[names.index(name)])) for name in chosen]
        figures = {
            figure: np.array([[floor[q][figure] for floor in found] for q in _QUANTITIES]) for figure in _FIGURES
        }
        facts = gauge_facts(total[names.index(chosen[0])])
        unit = facts["unit"]
        rows = [
            {"step": step, "quantity": q, "unit": quantity.unit_in(unit), **{k: _json(v) for k, v in floor[q].items()}}
            for step, floor in zip(chosen, found, strict=True)
            for q, quantity in _QUANTITIES.items()
        ]
        facts |= {"rigid": self.rigid, "summary": _summary(figures, unit)}
        return NoiseFloorTable.write(figures, chosen, list(_QUANTITIES), rows, facts)

    def _floor(self, total: Total) -> dict[str, dict[str, float]]:
        """The figures of each quantity at one step."""
        return {name: _figures(*field) for name, field in fields_at_rest(total, self.rigid).items()}


def fields_at_rest(total: Total, rigid: bool = True) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Values (n,) and stated σ (n,) of each quantity at the n points of a step without deformation.

    rigid : whether the best rigid-body motion is removed from the displacement first
    Raises StageError for a total without uncertainty, and for fewer than three points.
    """
    import numpy as np

    if not total.has_uncertainty:
        raise StageError("this total has no uncertainty to compare with; give one of a stage 'deformation'")
    known = np.isfinite(total["U"])
    if known.sum() < 3:
        raise StageError(f"a noise floor needs points, but a step has {known.sum()}; look at its correlation")
    errors, deviations = _displacement(total, known, rigid)
    fields = dict(zip("UVW", zip(errors.T, deviations.T, strict=True), strict=True))
    strains = [name for name, quantity in _QUANTITIES.items() if not quantity.is_displacement]
    return fields | {name: (total[name][known], total.sigma(name)[known]) for name in strains}


def _displacement(total: Total, known: np.ndarray, rigid: bool) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (n, 3) of the points and its predicted σ, without the rigid-body motion if ``rigid``."""
    import numpy as np

    from dicflow.core.cameras.frames import LEFT_CAMERA, into_frame
    from dicflow.core.cameras.rigid import co_moving_frame, rigid_motion
    from dicflow.core.tensors import symmetric
    from dicflow.core.uncertainty.covariance import displacement_variances

    reference, deformed = total["xyz_reference"][known], total["xyz"][known]
    covariance = symmetric(total["covariance"][known])
    along = LEFT_CAMERA
    if rigid:
        weights = 1.0 / np.maximum(displacement_variances(covariance).sum(axis=-1), 1e-12)
        try:
            along = co_moving_frame(rigid_motion(reference, deformed, weights))
        except ValueError as error:
            raise StageError(f"{error}; look at the points of the step, or use rigid: false") from error
    both = np.concatenate([along.rotation, -np.eye(3)], axis=1)
    variances = np.diagonal(both @ covariance @ both.T, axis1=-2, axis2=-1)
    return into_frame(deformed, along) - reference, np.sqrt(np.maximum(variances, 0.0))


def _figures(values: np.ndarray, predicted: np.ndarray) -> dict[str, float]:
    import numpy as np

    return {
        "bias": float(values.mean()),
        "sigma": float(values.std()),
        "predicted_sigma": float(np.sqrt(np.mean(predicted.astype(float) ** 2))),
        "points": int(values.size),
    }


def _summary(figures: Mapping[str, np.ndarray], unit: str) -> dict[str, float]:
    """Over all steps: the largest bias, and both σ as root mean squares."""
    import numpy as np

    summary: dict[str, float] = {}
    for row, quantity in enumerate(_QUANTITIES):
        name = named_with_unit(quantity, unit)
        summary[f"max_bias_{name}"] = float(np.abs(figures["bias"][row]).max())
        for figure in ("sigma", "predicted_sigma"):
            summary[f"{figure}_{name}"] = float(np.sqrt(np.mean(figures[figure][row] ** 2)))
    return summary


def _json(value: float) -> float | None:
    """The value; None for NaN and infinity, which JSON lacks."""
    return value if math.isfinite(value) else None


def sentence(stage: NoiseFloor, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    text = "The noise floor was measured at steps without deformation"
    if product is None:
        return text + "."
    table = NoiseFloorTable.read(product)
    summary = summary_of(product)
    figures = []
    for name in BASIC:
        if (sigma := summary.get(f"sigma_{named_with_unit(name, table.unit)}")) is not None:
            figures.append(figure_in_words(name, sigma, table.unit))
    steps = len(steps_of(product))
    return f"{text} ({steps} step{'s' * (steps > 1)}): its standard deviation was {', '.join(figures)} [idics2018]."
