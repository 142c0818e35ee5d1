"""Models of incompressible hyperelastic material: energy, its slopes, and their derivatives by the constants."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dicflow.core.arrays import Array

__all__ = ["MODELS", "Constant", "Model"]


@dataclass(frozen=True)
class Constant:
    """A constant of a model.

    name : as programs call it
    is_stress : whether it is in units of stress; otherwise a pure number
    least, most : limits of a fit
    """

    name: str
    is_stress: bool = True
    least: float = -math.inf
    most: float = math.inf


class Model(Protocol):
    """A model; ``c`` are its constants (p,), ``stretches`` principal stretches (..., 3) with product 1."""

    @property
    def title(self) -> str:
        """Its name, as literature has it."""

    @property
    def formula(self) -> str:
        """The energy, as text."""

    @property
    def constants(self) -> tuple[Constant, ...]:
        """Its constants, in the order of ``c``."""

    @property
    def is_linear(self) -> bool:
        """Whether stresses are linear in the constants."""

    def energy(self, c: Array, stretches: Array) -> Array:
        """W (...), 0 without deformation."""

    def slopes(self, c: Array, stretches: Array) -> Array:
        """tᵢ = λᵢ ∂W/∂λᵢ, (..., 3)."""

    def sensitivities(self, c: Array, stretches: Array) -> Array:
        """∂tᵢ/∂cⱼ, (..., 3, p)."""

    def curvatures(self, c: Array, stretches: Array) -> Array:
        """λⱼ ∂tᵢ/∂λⱼ, (..., 3, 3)."""

    def shear_modulus(self, c: Array) -> float:
        """μ0, the shear modulus without deformation; Young's modulus is three times it."""

    def shapes(self, largest: float) -> Array:
        """Values (m, q) of the q constants that are pure numbers, from which searches begin.

        largest : largest I1 − 3 of the tests
        """

    def limits(self, shape: Array, largest: float) -> tuple[Array, Array]:
        """Least and largest constants (p,) of a search that begins at a shape (q,)."""


def _limits(constants: Sequence[Constant]) -> tuple[Array, Array]:
    return np.array([one.least for one in constants]), np.array([one.most for one in constants])


def first_invariant(stretches: Array) -> Array:
    """I1 = λ1² + λ2² + λ3², (...)."""
    return np.asarray((stretches**2).sum(axis=-1))


Series = Callable[[Array, Array], Array]
"""Function of constants (p,) and I1 (...)."""


@dataclass(frozen=True)
class FirstInvariant:
    """A model whose energy f depends on I1 alone, tᵢ = 2 f′ λᵢ².

    f, first, second : f, f′ and f″, each (...)
    by_constant : ∂f′/∂c, (..., p)
    tried : factors by which values of the pure number are tried; of what, ``scale`` computes from the largest I1 − 3
    has_limit : whether I1 − 3 stays below that number
    """

    title: str
    formula: str
    constants: tuple[Constant, ...]
    is_linear: bool
    f: Series
    first: Series
    second: Series
    by_constant: Series
    tried: tuple[float, ...] = ()
    scale: Callable[[float], float] = float
    has_limit: bool = False

    def energy(self, c: Array, stretches: Array) -> Array:
        return self.f(c, first_invariant(stretches))

    def slopes(self, c: Array, stretches: Array) -> Array:
        return np.asarray(2.0 * self.first(c, first_invariant(stretches))[..., None] * stretches**2)

    def sensitivities(self, c: Array, stretches: Array) -> Array:
        slope = self.by_constant(c, first_invariant(stretches))
        return np.asarray(2.0 * (stretches**2)[..., :, None] * slope[..., None, :])

    def curvatures(self, c: Array, stretches: Array) -> Array:
        squares, invariant = stretches**2, first_invariant(stretches)
        straight = squares[..., :, None] * np.eye(3) * self.first(c, invariant)[..., None, None]
        bent = squares[..., :, None] * squares[..., None, :] * self.second(c, invariant)[..., None, None]
        return np.asarray(4.0 * (straight + bent))

    def shear_modulus(self, c: Array) -> float:
        return float(2.0 * self.first(c, np.array(3.0)))

    def shapes(self, largest: float) -> Array:
        if not self.tried:
            return np.zeros((1, 0))
        return self.scale(largest) * np.array(self.tried)[:, None]

    def limits(self, shape: Array, largest: float) -> tuple[Array, Array]:
        least, most = _limits(self.constants)
        if self.has_limit:
            least[-1] = 1.001 * largest
        return least, most


def _polynomial(c: Array, invariant: Array, derivative: int) -> Array:
    """A derivative of Σ cᵢ (I1 − 3)ⁱ, i from 1."""
    series = np.polynomial.Polynomial([0.0, *c])
    found = series.deriv(derivative) if derivative else series
    return np.asarray(found(invariant - 3.0))


def _yeoh(title: str, formula: str, count: int) -> FirstInvariant:
    """W = Σ Cᵢ0 (I1 − 3)ⁱ up to the power ``count``."""
    powers = np.arange(count)
    return FirstInvariant(
        title=title,
        formula=formula,
        constants=tuple(Constant(f"C{i}0") for i in range(1, count + 1)),
        is_linear=True,
        f=lambda c, i1: _polynomial(c, i1, 0),
        first=lambda c, i1: _polynomial(c, i1, 1),
        second=lambda c, i1: _polynomial(c, i1, 2),
        by_constant=lambda c, i1: (powers + 1) * (i1[..., None] - 3.0) ** powers,
    )


_GENT = FirstInvariant(
    title="Gent",
    formula="W = −μ Jm/2 ln(1 − (I1 − 3)/Jm)",
    constants=(Constant("mu", least=0.0), Constant("Jm", False, 0.0, 1e4)),
    is_linear=False,
    f=lambda c, i1: -c[0] * c[1] / 2.0 * np.log1p(-(i1 - 3.0) / c[1]),
    first=lambda c, i1: c[0] * c[1] / 2.0 / (c[1] - i1 + 3.0),
    second=lambda c, i1: c[0] * c[1] / 2.0 / (c[1] - i1 + 3.0) ** 2,
    by_constant=lambda c, i1: np.stack(
        [c[1] / 2.0 / (c[1] - i1 + 3.0), -c[0] / 2.0 * (i1 - 3.0) / (c[1] - i1 + 3.0) ** 2], axis=-1
    ),
    tried=(1.05, 1.2, 1.5, 2.0, 4.0, 10.0, 100.0),
    has_limit=True,
)

_ARRUDA_BOYCE_SERIES = np.array([1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750])
"""Factors of the inverse Langevin function, as a series of five terms."""


def _arruda_boyce(c: Array, invariant: Array, derivative: int) -> Array:
    """A derivative of μ Σ aᵢ (I1ⁱ − 3ⁱ) / λm^(2i−2) by I1."""
    factors = c[0] * _ARRUDA_BOYCE_SERIES / c[1] ** (2.0 * np.arange(5))
    series = np.polynomial.Polynomial([0.0, *factors])
    found = series.deriv(derivative)(invariant) if derivative else series(invariant) - series(3.0)
    return np.asarray(found)


def _arruda_boyce_by_constant(c: Array, invariant: Array) -> Array:
    order = np.arange(5)
    factors = _ARRUDA_BOYCE_SERIES * (order + 1) / c[1] ** (2.0 * order)
    powers = invariant[..., None] ** order
    return np.stack([powers @ factors, powers @ (factors * -2.0 * order) * c[0] / c[1]], axis=-1)


_ARRUDA_BOYCE = FirstInvariant(
    title="Arruda–Boyce",
    formula="W = μ Σ aᵢ (I1ⁱ − 3ⁱ) / λm^(2i−2), aᵢ = 1/2, 1/20, 11/1050, 19/7000, 519/673750",
    constants=(Constant("mu", least=0.0), Constant("lambda_m", False, 0.3, 50.0)),
    is_linear=False,
    f=lambda c, i1: _arruda_boyce(c, i1, 0),
    first=lambda c, i1: _arruda_boyce(c, i1, 1),
    second=lambda c, i1: _arruda_boyce(c, i1, 2),
    by_constant=_arruda_boyce_by_constant,
    tried=(0.5, 0.7, 1.0, 1.5, 3.0, 10.0),
    scale=lambda largest: math.sqrt(largest / 3.0 + 1.0),
)


@dataclass(frozen=True)
class Powers:
    """A model whose energy is a sum of powers of each stretch: W = Σ μₖ/αₖ (λ1^αₖ + λ2^αₖ + λ3^αₖ − 3).

    Constants are μ1, α1, μ2, α2 …; tᵢ = Σ μₖ λᵢ^αₖ and μ0 = ½ Σ μₖ αₖ.
    """

    title: str
    formula: str
    count: int
    is_linear: bool = False

    @property
    def constants(self) -> tuple[Constant, ...]:
        return tuple(
            constant
            for k in range(1, self.count + 1)
            for constant in (Constant(f"mu{k}"), Constant(f"alpha{k}", False, -MOST_EXPONENT, MOST_EXPONENT))
        )

    def energy(self, c: Array, stretches: Array) -> Array:
        mu, alpha = c[0::2], c[1::2]
        return np.asarray(((stretches[..., None] ** alpha - 1.0) * mu / alpha).sum(axis=(-1, -2)))

    def slopes(self, c: Array, stretches: Array) -> Array:
        return np.asarray((stretches[..., None] ** c[1::2] * c[0::2]).sum(axis=-1))

    def sensitivities(self, c: Array, stretches: Array) -> Array:
        powers, logs = stretches[..., None] ** c[1::2], np.log(stretches)[..., None]
        by_pair = np.stack([powers, c[0::2] * powers * logs], axis=-1)
        return by_pair.reshape(*stretches.shape, -1)

    def curvatures(self, c: Array, stretches: Array) -> Array:
        diagonal = (stretches[..., None] ** c[1::2] * c[0::2] * c[1::2]).sum(axis=-1)
        return np.asarray(diagonal[..., None] * np.eye(3))

    def shear_modulus(self, c: Array) -> float:
        return float(c[0::2] @ c[1::2] / 2.0)

    def shapes(self, largest: float) -> Array:
        return np.array(list(itertools.combinations(_EXPONENTS, self.count)))

    def limits(self, shape: Array, largest: float) -> tuple[Array, Array]:
        """Each exponent keeps its sign, and its factor has the same: μₖ αₖ > 0."""
        least, most = _limits(self.constants)
        positive, nearest = np.repeat(shape > 0.0, 2), np.tile([0.0, LEAST_EXPONENT], self.count)
        return np.where(positive, nearest, least), np.where(positive, most, -nearest)


LEAST_EXPONENT, MOST_EXPONENT = 0.02, 25.0
"""Limits of the size of Ogden's exponents in a fit."""
_EXPONENTS = (-16.0, -8.0, -4.0, -2.0, -1.0, 0.6, 1.0, 1.6, 2.5, 4.0, 6.0, 9.0, 14.0)
"""Exponents at which searches begin."""


@dataclass(frozen=True)
class _MooneyRivlin:
    """W = C10 (I1 − 3) + C01 (I2 − 3): powers with the exponents 2 and −2, since I2 = λ1⁻² + λ2⁻² + λ3⁻²."""

    title: str = "Mooney–Rivlin"
    formula: str = "W = C10 (I1 − 3) + C01 (I2 − 3)"
    constants: tuple[Constant, ...] = (Constant("C10"), Constant("C01"))
    is_linear: bool = True

    def energy(self, c: Array, stretches: Array) -> Array:
        return _TWO_POWERS.energy(_powers_of(c), stretches)

    def slopes(self, c: Array, stretches: Array) -> Array:
        return _TWO_POWERS.slopes(_powers_of(c), stretches)

    def sensitivities(self, c: Array, stretches: Array) -> Array:
        return np.stack([2.0 * stretches**2, -2.0 * stretches**-2], axis=-1)

    def curvatures(self, c: Array, stretches: Array) -> Array:
        return _TWO_POWERS.curvatures(_powers_of(c), stretches)

    def shear_modulus(self, c: Array) -> float:
        return float(2.0 * c.sum())

    def shapes(self, largest: float) -> Array:
        return np.zeros((1, 0))

    def limits(self, shape: Array, largest: float) -> tuple[Array, Array]:
        return _limits(self.constants)


def _powers_of(c: Array) -> Array:
    """C10 and C01 as constants of two powers."""
    return np.array([2.0 * c[0], 2.0, -2.0 * c[1], -2.0])


_OGDEN = "W = Σ μk/αk (λ1^αk + λ2^αk + λ3^αk − 3)"
_TWO_POWERS = Powers("Ogden, 2 terms", _OGDEN, 2)

MODELS: dict[str, Model] = {
    "neo_hooke": _yeoh("neo-Hooke", "W = C10 (I1 − 3)", 1),
    "mooney_rivlin": _MooneyRivlin(),
    "yeoh": _yeoh("Yeoh", "W = C10 (I1 − 3) + C20 (I1 − 3)² + C30 (I1 − 3)³", 3),
    "ogden_1": Powers("Ogden, 1 term", _OGDEN, 1),
    "ogden_2": _TWO_POWERS,
    "ogden_3": Powers("Ogden, 3 terms", _OGDEN, 3),
    "gent": _GENT,
    "arruda_boyce": _ARRUDA_BOYCE,
}
"""All models by their names in pipeline files."""
