"""Models of a material fitted to curves of stress and stretch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from dicflow.engine.product import Product, Variable
from dicflow.kinds.kind import Table

if TYPE_CHECKING:
    import numpy as np

__all__ = ["FittedConstant", "FittedCurve", "FittedModel", "Material"]


class FittedConstant(NamedTuple):
    """One constant of a fitted model.

    unit : MPa, or "1"
    independent, common : shares of its standard uncertainty
    half_width : half its interval of 95 %
    at_limit : whether it stopped at a limit of the search, so that the tests do not show it
    """

    name: str
    unit: str
    value: float
    independent: float
    common: float
    half_width: float
    at_limit: bool

    @property
    def is_certain(self) -> bool:
        """Whether its interval of 95 % leaves its sign certain."""
        return not self.at_limit and abs(self.value) > self.half_width


class FittedModel(NamedTuple):
    """One model, fitted to all curves together. Lists by curve are in the order of :attr:`Material.curves`.

    title, formula : of the model
    covariance, correlation : (p, p) as lists of rows; the correlation is by the errors of single points
    rms : of the residuals, relative to the stress, by curve
    left_out : error by which the fit to the other curves predicts each one, relative to the stress; None if unknown
    rms_all : of the residuals of all points
    scatter : of the points about the model beyond their uncertainty, relative to the stress; all if u is unknown
    misfit_ratio : χ² per degree of freedom without that scatter; None if the uncertainty of the points is unknown
    freedom : number of points or equations less that of the constants
    shear_modulus, young_modulus : without deformation, each with half its interval of 95 % [MPa]
    unstable : mode → stretch from which it is unstable, within the largest measured stretch and 10 % beyond
    unsure : names and correlation of constants that the curves do not tell apart
    others : other constants that fit as well and predict other stresses, (m, p)
    """

    name: str
    title: str
    formula: str
    constants: Sequence[FittedConstant]
    covariance: Sequence[Sequence[float]]
    correlation: Sequence[Sequence[float]]
    condition: float
    aicc: float | None
    rms: Sequence[float]
    left_out: Sequence[float | None]
    rms_all: float
    scatter: float
    misfit_ratio: float | None
    freedom: int
    shear_modulus: tuple[float, float]
    young_modulus: tuple[float, float]
    unstable: Mapping[str, float]
    unsure: Sequence[tuple[str, str, float]]
    others: Sequence[Sequence[float]]

    @property
    def values(self) -> list[float]:
        """Values of the constants."""
        return [constant.value for constant in self.constants]


class FittedCurve(NamedTuple):
    """A curve that models were fitted to. points : its number; common : relative share that all its stresses share"""

    name: str
    mode: str
    points: int
    common: float


class Material(Table):
    """Fitted models, the best first, with the points that they were fitted to; the table has a row per constant."""

    KINDS: ClassVar = ("material",)

    @classmethod
    def write(
        cls,
        curves: Sequence[FittedCurve],
        points: Mapping[str, Variable],
        models: Sequence[FittedModel],
        refused: Mapping[str, str],
        verdict: Sequence[str],
        facts: Mapping[str, Any],
    ) -> Product:
        """A product of fitted models.

        points : arrays (point,), of all curves one after the other
        models : the best first
        refused : name of a model → why it was not fitted
        verdict : what the tests can say and what they cannot, in sentences
        facts : further attributes: summary, warnings
        """
        attrs = {
            "curves": [one._asdict() for one in curves],
            "models": [_plain(one) for one in models],
            "refused": dict(refused),
            "verdict": list(verdict),
            "rows": [row for one in models for row in _rows(one)],
        }
        return Product("material", points, {**attrs, **facts})

    @property
    def curves(self) -> Sequence[FittedCurve]:
        """The curves that were fitted."""
        return tuple(FittedCurve(**one) for one in self.product.attrs["curves"])

    @property
    def models(self) -> Sequence[FittedModel]:
        """The fitted models, the best first."""
        return tuple(_read(one) for one in self.product.attrs["models"])

    @property
    def refused(self) -> Mapping[str, str]:
        """Name of a model → why it was not fitted."""
        return dict(self.product.attrs["refused"])

    @property
    def verdict(self) -> Sequence[str]:
        """What the tests can say and what they cannot, in sentences."""
        return tuple(self.product.attrs["verdict"])

    @property
    def is_of_fields(self) -> bool:
        """Whether the curves are mean stretches of whole fields, and stresses of models their mean."""
        return "force_balance" in self

    def of_curve(self, name: str, index: int) -> np.ndarray:
        """The part of an array that belongs to one curve. index : of the curve"""
        found: np.ndarray = self[name][self["curve"] == index]
        return found


def _plain(model: FittedModel) -> dict[str, Any]:
    return {**model._asdict(), "constants": [constant._asdict() for constant in model.constants]}


def _read(entry: Mapping[str, Any]) -> FittedModel:
    constants = [FittedConstant(**one) for one in entry["constants"]]
    pairs = {name: tuple(entry[name]) for name in ("shear_modulus", "young_modulus")}
    unsure = [tuple(pair) for pair in entry["unsure"]]
    return FittedModel(**{**entry, **pairs, "constants": constants, "unsure": unsure})


def _rows(model: FittedModel) -> list[dict[str, Any]]:
    return [
        {
            "model": model.name,
            "constant": one.name,
            "unit": one.unit,
            "value": one.value,
            "low_95": None if one.at_limit else one.value - one.half_width,
            "high_95": None if one.at_limit else one.value + one.half_width,
            "u_independent": one.independent,
            "u_common": one.common,
            "at_limit": one.at_limit,
        }
        for one in model.constants
    ]
