"""Stress and stretch of one test, with their uncertainty."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from dicflow.engine.product import Product, Variable
from dicflow.kinds.kind import Layout, Table, steps_of

if TYPE_CHECKING:
    import numpy as np

__all__ = ["StressCurve", "StressPoints"]

_LAYOUTS = {
    "load": Layout(("step",), "N", "load"),
    "stretch": Layout(("step",), "1", "stretch along the load"),
    "lateral_stretch": Layout(("step",), "1", "stretch across the load"),
    "nominal_stress": Layout(("step",), "MPa", "nominal stress, load per first section"),
    "true_stress": Layout(("step",), "MPa", "true stress, load per present section"),
    "secant_modulus": Layout(("step",), "MPa", "secant modulus P / (λ − 1)"),
    "tangent_modulus": Layout(("step",), "MPa", "tangent modulus dP/dλ"),
    "poisson_ratio": Layout(("step",), "1", "Poisson's ratio −(λ2 − 1) / (λ1 − 1)"),
    "hencky_ratio": Layout(("step",), "1", "Hencky ratio −ln λ2 / ln λ1"),
}
"""Values at every step. With ``u_`` before the name: the independent share of their uncertainty; with ``common_``: the
share that all steps have in common, as the thickness has."""


class StressPoints(NamedTuple):
    """What a fit needs of one curve; see :class:`dicflow.core.material.fit.Curve`. All arrays (n,), NaN left out.

    lateral : stretch across the load; None unless the mode is biaxial
    u_stress, u_stretch : None if unknown
    """

    stretch: np.ndarray
    lateral: np.ndarray | None
    stress: np.ndarray
    u_stress: np.ndarray | None
    u_stretch: np.ndarray | None


class StressCurve(Table):
    """One value per step, the first step included. Arrays that the test does not give are absent."""

    KINDS: ClassVar = ("curve",)

    @classmethod
    def write(
        cls,
        values: Mapping[str, np.ndarray],
        steps: Sequence[str],
        phases: Sequence[str],
        mode: str,
        common: tuple[float, float],
        facts: Mapping[str, Any],
    ) -> Product:
        """A product of values by step.

        values : of the names above, (step,) each, NaN where unknown
        phases : of each step, loading or unloading
        mode : how the specimen deforms across the load, see :mod:`dicflow.core.material.modes`
        common : shares of stress and stretch, relative to them, that all steps have in common
        facts : further attributes: summary, warnings
        """
        variables = {name: _variable(name, array) for name, array in values.items()}
        attrs = {
            "steps": list(steps),
            "phases": list(phases),
            "mode": mode,
            "common": list(common),
            "rows": _rows(variables, steps, phases),
        }
        return Product("curve", variables, {**attrs, **facts})

    @property
    def steps(self) -> Sequence[str]:
        """Names of all steps."""
        return tuple(steps_of(self.product))

    @property
    def phases(self) -> Sequence[str]:
        """Of each step, loading or unloading."""
        return tuple(self.product.attrs["phases"])

    @property
    def mode(self) -> str:
        """How the specimen deforms across the load."""
        return str(self.product.attrs["mode"])

    @property
    def common(self) -> tuple[float, float]:
        """Shares of stress and stretch, relative to them, that all steps have in common."""
        stress, stretch = self.product.attrs["common"]
        return float(stress), float(stretch)

    def points(self, phase: str | None, least: float, most: float) -> StressPoints:
        """The known points of a phase, or of both, with stretches in a range and a stress that is not 0."""
        import numpy as np

        stretch, stress = self["stretch"], self["nominal_stress"]
        chosen = np.isfinite(stretch) & np.isfinite(stress) & (stretch >= least) & (stretch <= most)
        chosen &= ~((stress == 0.0) & (np.abs(stretch - 1.0) < 1e-9))
        if phase is not None:
            chosen &= np.array([one == phase for one in self.phases])
        lateral = self._part("lateral_stretch", chosen) if self.mode == "biaxial" else None
        u_stress, u_stretch = (self._part(f"u_{name}", chosen) for name in ("nominal_stress", "stretch"))
        return StressPoints(stretch[chosen], lateral, stress[chosen], u_stress, u_stretch)

    def _part(self, name: str, chosen: np.ndarray) -> np.ndarray | None:
        found: np.ndarray | None = self[name][chosen] if name in self else None
        return found


def _variable(name: str, values: np.ndarray) -> Variable:
    for prefix, title in (("u_", "standard uncertainty of the {}"), ("common_", "common share in that of the {}")):
        if name.startswith(prefix):
            layout = _LAYOUTS[name.removeprefix(prefix)]
            return layout._replace(long_name=title.format(layout.long_name))(values)
    return _LAYOUTS[name](values)


def _rows(variables: Mapping[str, Variable], steps: Sequence[str], phases: Sequence[str]) -> list[dict[str, Any]]:
    """One row per step; a column's name ends in the unit."""
    named = {name if one.units == "1" else f"{name}_{one.units}": one.values for name, one in variables.items()}
    return [
        {"step": step, "phase": phase, **{name: _json(values[index]) for name, values in named.items()}}
        for index, (step, phase) in enumerate(zip(steps, phases, strict=True))
    ]


def _json(value: float) -> float | None:
    """The value; None for NaN and infinity, which JSON lacks."""
    return float(value) if math.isfinite(value) else None
