"""Constants of a model from the curves of one or several tests, with their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, least_squares, nnls
from scipy.stats import chi2, norm, t

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.material.models import Model
from dicflow.core.material.modes import MODES, principal_stretches
from dicflow.core.material.response import nominal_stress, stress_by_constants, stress_by_stretch

__all__ = ["Curve", "Fit", "corrected_criterion", "correlation_of", "fit", "largest_invariant", "relative_errors"]

_LEAST_SHARE = 0.05
"""Errors in proportion to the stress are at least those of this share of the largest stress."""
_SEARCHES = 4
"""Searches with each combination of signs."""
_MOST_STEPS = 100
"""Steps of one search."""
_ROUNDS = 3
"""Fits with weights from the slope and the scatter of the one before."""
_ROUGH, _LEAST_SCATTER = 0.02, 1e-9
"""Scatter during the search, and the least one that is not 0."""
_SAME = 0.01
"""Relative difference of stresses up to which two predictions are the same."""


class Curve(NamedTuple):
    """Stretches and nominal stresses of one test.

    mode : see :mod:`dicflow.core.material.modes`
    stretches : (n, 3) — principal stretches, along the load first
    stress : (n,) — nominal stress along the load
    u_stress : (n,) — independent share of its standard uncertainty; None if unknown
    u_stretch : (n,) — the same of the stretch along the load
    common_stress, common_stretch : common shares, relative to stress and stretch
    """

    name: str
    mode: str
    stretches: Array
    stress: Array
    u_stress: Array | None = None
    u_stretch: Array | None = None
    common_stress: float = 0.0
    common_stretch: float = 0.0


class Fit(NamedTuple):
    """A model fitted to curves.

    constants : (p,)
    independent, common : (p, p) — covariance by the errors of single points, and by those that all points share
    factor : half the width of an interval of 95 % in standard deviations of the independent share
    errors : of each curve, predicted minus measured nominal stress, (n,)
    scatter : of the points about the model beyond their uncertainty, relative to the stress; all where u is unknown
    misfit_ratio : χ² per degree of freedom without that scatter; NaN if the uncertainty of the points is unknown
    aicc : Akaike's criterion, corrected for few points; comparable between models of the same curves
    condition : of the weighted sensitivities, each constant in units of its own size
    at_limit : (p,) bool — constants that stopped at a limit of the search; they have no uncertainty
    others : (m, p) — other minima that are as good within the scatter, and predict other stresses
    """

    constants: Array
    independent: Array
    common: Array
    factor: float
    errors: tuple[Array, ...]
    scatter: float
    misfit_ratio: float
    aicc: float
    condition: float
    at_limit: Mask
    others: Array

    @property
    def covariance(self) -> Array:
        """Of the constants, all shares together, (p, p)."""
        return self.independent + self.common

    @property
    def correlation(self) -> Array:
        """Of the constants by the independent share, (p, p); NaN for those at a limit."""
        return correlation_of(self.independent)

    @property
    def half_width(self) -> Array:
        """Half the width of each constant's interval of 95 %, (p,); NaN for those at a limit."""
        return self.half_width_of(np.eye(len(self.constants)))

    def half_width_of(self, gradient: Array) -> Array:
        """Half the width of the interval of 95 % of what has this gradient (..., p) by the constants."""
        independent = np.einsum("...i,ij,...j->...", gradient, self.independent, gradient)
        common = np.einsum("...i,ij,...j->...", gradient, self.common, gradient)
        return np.asarray(np.sqrt(np.maximum(0.0, self.factor**2 * independent + _NORMAL**2 * common)))


_NORMAL = float(norm.ppf(0.975))


def correlation_of(covariance: Array) -> Array:
    """Correlation (p, p) of constants from their covariance (p, p); NaN for those without a variance."""
    scale = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(covariance / np.outer(scale, scale))


def fit(model: Model, curves: Sequence[Curve]) -> Fit:
    """Fit by least squares; a point's variance is u², that of the stretch times the slope squared, and a scatter.

    The scatter is in proportion to the stress, and just as large as makes χ² the number of degrees of freedom; 0 where
    u explains the residuals (5 % level). Searches begin at many shapes: for each, the constants in units of stress
    follow linearly, and the best shapes of each combination of signs are refined within limits. Of minima that do not
    differ by more than the scatter, the one with the smallest pure numbers is taken.
    Raises ValueError if there are not more points than constants.
    """
    points, count = sum(len(curve.stress) for curve in curves), len(model.constants)
    if points <= count:
        raise ValueError(f"{points} points for {count} constants; more points than constants are needed")
    rough = np.concatenate([_sigma(curve, 0.0, _ROUGH) for curve in curves])
    best, others = _simplest(model, curves, _minima(model, curves, rough))
    scatter = _scatter(model, best, curves)
    for _ in range(_ROUNDS):
        best = _refined(model, curves, _sigmas(model, best, curves, scatter), best)[0]
        scatter = _scatter(model, best, curves)
    return _fitted(model, curves, scatter, best)._replace(others=others)


def relative_errors(fitted: Sequence[Array], curves: Sequence[Curve]) -> list[float]:
    """Root mean square of errors of each curve, in units of its stress. fitted : of each curve its errors (n,)"""
    return [
        float(np.sqrt(np.mean((errors / _scale(curve)) ** 2))) for errors, curve in zip(fitted, curves, strict=True)
    ]


def largest_invariant(curves: Sequence[Curve]) -> float:
    """Largest I1 − 3 of some curves."""
    return max(float((curve.stretches**2).sum(axis=-1).max()) - 3.0 for curve in curves)


def _scale(curve: Curve) -> Array:
    """The size of the stress at each point, (n,): of small ones a share of the largest."""
    size = np.abs(curve.stress)
    return np.asarray(np.maximum(size, _LEAST_SHARE * size.max()))


def _sigma(curve: Curve, slope: Array | float, scatter: float) -> Array:
    """Standard deviation of the stress at each point, (n,). slope : dP/dλ, (n,)"""
    u_stress = 0.0 if curve.u_stress is None else curve.u_stress
    u_stretch = 0.0 if curve.u_stretch is None else curve.u_stretch
    return np.asarray(np.sqrt(u_stress**2 + (slope * u_stretch) ** 2 + (scatter * _scale(curve)) ** 2))


def _sigmas(model: Model, c: Array, curves: Sequence[Curve], scatter: float) -> Array:
    """Standard deviations of all points of all curves, (n,)."""
    slopes = [stress_by_stretch(model, c, curve.mode, curve.stretches) for curve in curves]
    return np.concatenate([_sigma(curve, slope, scatter) for curve, slope in zip(curves, slopes, strict=True)])


def _is_known(curves: Sequence[Curve]) -> bool:
    """Whether the uncertainty of all points is known."""
    return all(curve.u_stress is not None for curve in curves)


def _scatter(model: Model, c: Array, curves: Sequence[Curve]) -> float:
    """Scatter beyond the uncertainty of the points, relative to the stress: with it χ² is the degrees of freedom."""
    residuals = _stresses(model, c, curves) - _measured(curves)
    freedom, size = len(residuals) - len(c), np.concatenate([_scale(curve) for curve in curves])
    if not _is_known(curves):
        return float(np.sqrt(np.sum((residuals / size) ** 2) / freedom)) or _LEAST_SCATTER
    known = _sigmas(model, c, curves, 0.0)
    if np.sum((residuals / known) ** 2) <= chi2.ppf(0.95, freedom):
        return 0.0

    def excess(log: float) -> float:
        return float(np.sum(residuals**2 / (known**2 + (np.exp(log) * size) ** 2)) - freedom)

    most = 0.5 * float(np.log(np.sum((residuals / size) ** 2) / freedom + 1e-300)) + 0.01
    return float(np.exp(brentq(excess, np.log(_LEAST_SCATTER), most))) if excess(np.log(_LEAST_SCATTER)) > 0.0 else 0.0


def _measured(curves: Sequence[Curve]) -> Array:
    return np.concatenate([curve.stress for curve in curves])


def _stresses(model: Model, c: Array, curves: Sequence[Curve]) -> Array:
    return np.concatenate([nominal_stress(model, c, curve.stretches) for curve in curves])


def _jacobian(model: Model, c: Array, curves: Sequence[Curve]) -> Array:
    return np.concatenate([stress_by_constants(model, c, curve.stretches) for curve in curves])


def _minima(model: Model, curves: Sequence[Curve], sigma: Array) -> list[tuple[float, Array]]:
    """χ² and constants where the searches ended, the best first."""
    starts: dict[tuple[float, ...], list[tuple[float, Array]]] = {}
    for shape in model.shapes(largest_invariant(curves)):
        cost = float(np.sum(_best_with(model, curves, sigma, shape)[1] ** 2))
        starts.setdefault(tuple(np.sign(shape)), []).append((cost, shape))
    chosen = [shape for group in starts.values() for _, shape in sorted(group, key=lambda pair: pair[0])[:_SEARCHES]]
    found = [_refined(model, curves, sigma, _searched(model, curves, sigma, shape)) for shape in chosen]
    return sorted(((cost, c) for c, cost in found), key=lambda pair: pair[0])


def _searched(model: Model, curves: Sequence[Curve], sigma: Array, shape: Array) -> Array:
    """Constants at the minimum over all shapes that a search from one finds, each with its best factors."""
    if shape.size:
        least, most = (limit[_numbers(model)] for limit in model.limits(shape, largest_invariant(curves)))
        shape = least_squares(
            lambda x: _best_with(model, curves, sigma, x)[1],
            np.clip(shape, least, most),
            bounds=(least, most),
            x_scale=np.abs(shape),
            max_nfev=_MOST_STEPS,
        ).x
    return _best_with(model, curves, sigma, shape)[0]


def _best_with(model: Model, curves: Sequence[Curve], sigma: Array, shape: Array) -> tuple[Array, Array]:
    """The constants with the best factors for a shape, within the limits, and their weighted residuals."""
    numbers = _numbers(model)
    c = np.ones(len(numbers))
    c[numbers] = shape
    least, most = (limit[~numbers] for limit in model.limits(shape, largest_invariant(curves)))
    design = _jacobian(model, c, curves)[:, ~numbers] / sigma[:, None]
    measured = _measured(curves) / sigma
    size = np.linalg.norm(design, axis=0)
    if np.isinf(least).all() and np.isinf(most).all():
        factors = np.linalg.lstsq(design / size, measured, rcond=None)[0] / size
    else:
        sign = np.where(most <= 0.0, -1.0, 1.0)
        factors = sign * nnls(design * (sign / size), measured)[0] / size
    c[~numbers] = factors
    return c, design @ factors - measured


def _numbers(model: Model) -> Mask:
    """The constants that are pure numbers, (p,); stresses are linear in all others."""
    return np.array([not one.is_stress for one in model.constants])


def _refined(model: Model, curves: Sequence[Curve], sigma: Array, c: Array) -> tuple[Array, float]:
    """Constants at the minimum that a search from ``c`` finds, and χ² there."""
    measured = _measured(curves)
    least, most = model.limits(c[_numbers(model)], largest_invariant(curves))
    with np.errstate(over="ignore", invalid="ignore"):
        found = least_squares(
            lambda x: np.nan_to_num((_stresses(model, x, curves) - measured) / sigma, nan=1e9, posinf=1e9, neginf=-1e9),
            np.clip(c, least, most),
            lambda x: np.nan_to_num(_jacobian(model, x, curves) / sigma[:, None]),
            bounds=(least, most),
            x_scale="jac",
            max_nfev=_MOST_STEPS,
        )
    return found.x, float(2.0 * found.cost)


def _simplest(model: Model, curves: Sequence[Curve], minima: Sequence[tuple[float, Array]]) -> tuple[Array, Array]:
    """Of the minima that are as good as the best within the scatter, that with the smallest pure numbers; others."""
    freedom, numbers, least = len(_measured(curves)) - len(model.constants), _numbers(model), minima[0][0]
    alike = [c for cost, c in minima if cost <= least * (1.0 + 1.0 / freedom) + 1e-12]
    best = min(alike, key=lambda c: float(np.abs(c[numbers]).max(initial=0.0)))
    others: list[Array] = []
    for c in alike:
        if all(_differ(model, curves, c, known) for known in (best, *others)):
            others.append(c)
    return best, np.array(others).reshape(-1, len(model.constants))


def _differ(model: Model, curves: Sequence[Curve], one: Array, other: Array) -> bool:
    """Whether two sets of constants predict different stresses in some mode, within the largest I1 of the curves."""
    largest = largest_invariant(curves)
    for mode in MODES:
        stretch = np.linspace(1.05, 10.0, 400)
        stretches = principal_stretches(mode, stretch)
        inside = stretches[(stretches**2).sum(axis=-1) - 3.0 <= largest][::20]
        first, second = (nominal_stress(model, c, inside) for c in (one, other))
        if (np.abs(first - second) > _SAME * np.abs(first + second) / 2.0).any():
            return True
    return False


def _fitted(model: Model, curves: Sequence[Curve], scatter: float, c: Array) -> Fit:
    """The fit with its uncertainty at constants ``c``, where the search ended."""
    sigma, residuals = _sigmas(model, c, curves, scatter), _stresses(model, c, curves) - _measured(curves)
    sensitivity, freedom = _jacobian(model, c, curves) / sigma[:, None], len(sigma) - len(c)
    least, most = model.limits(c[_numbers(model)], largest_invariant(curves))
    at_limit = _is_near(c, least) | _is_near(c, most)
    solver = _solver(sensitivity, at_limit)
    bare = _sigmas(model, c, curves, 0.0) if _is_known(curves) else np.full(len(sigma), np.nan)
    return Fit(
        constants=c,
        independent=solver @ solver.T,
        common=_common(model, c, curves, solver / sigma),
        factor=float(t.ppf(0.975, freedom)) if scatter else _NORMAL,
        errors=tuple(np.split(residuals, _ends(curves))),
        scatter=scatter,
        misfit_ratio=float(np.sum((residuals / bare) ** 2) / freedom),
        aicc=_aicc(float(np.sum((residuals / sigma) ** 2)), sigma, len(c)),
        condition=float(np.linalg.cond(sensitivity[:, ~at_limit] * c[~at_limit])),
        at_limit=at_limit,
        others=np.zeros((0, len(c))),
    )


def _ends(curves: Sequence[Curve]) -> Index:
    """Where the curves but the first begin among all points."""
    return np.cumsum([len(curve.stress) for curve in curves])[:-1]


def _is_near(c: Array, limit: Array) -> Mask:
    """Constants at a limit that is not infinite; a stress factor near 0 too."""
    near = np.abs(c - limit) <= 1e-4 * np.maximum(np.abs(limit), 1e-6 * np.abs(c).max())
    return np.asarray(np.isfinite(limit) & near)


def _solver(sensitivity: Array, at_limit: Mask) -> Array:
    """(JᵀJ)⁻¹Jᵀ of the weighted sensitivities (n, p), without the constants at a limit, whose rows are 0; (p, n)."""
    found = np.zeros(sensitivity.T.shape)
    size = np.linalg.norm(sensitivity[:, ~at_limit], axis=0)
    found[~at_limit] = np.linalg.pinv(sensitivity[:, ~at_limit] / size) / size[:, None]
    return found


def _common(model: Model, c: Array, curves: Sequence[Curve], by_stress: Array) -> Array:
    """Covariance of the constants by errors that points share, (p, p). by_stress : ∂c/∂P, (p, n)

    That of the stress is one error for all curves, as the thickness of one sheet; that of the stretch, which comes from
    the first length, is one for each.
    """
    parts = np.split(by_stress, _ends(curves), axis=1)
    slopes = [stress_by_stretch(model, c, curve.mode, curve.stretches) * curve.stretches[:, 0] for curve in curves]
    by_length = [part @ slope * curve.common_stretch for curve, part, slope in zip(curves, parts, slopes, strict=True)]
    by_section = sum(part @ curve.stress * curve.common_stress for curve, part in zip(curves, parts, strict=True))
    return np.asarray(sum(np.outer(shift, shift) for shift in (*by_length, by_section)))


def _aicc(chi_squared: float, sigma: Array, constants: int) -> float:
    """Akaike's corrected criterion of weighted points, comparable where the weights differ."""
    return corrected_criterion(chi_squared, len(sigma), constants) + 2.0 * float(np.log(sigma).sum())


def corrected_criterion(chi_squared: float, points: int, constants: int) -> float:
    """Akaike's corrected criterion with a common factor of all variances estimated; infinite with too few points."""
    estimated = constants + 1
    if points <= estimated + 1:
        return float("inf")
    correction = 2.0 * estimated * (estimated + 1) / (points - estimated - 1)
    return float(points * np.log(max(chi_squared, 1e-300) / points) + 2.0 * estimated + correction)
