"""Constants of a model from the curves of one or several tests, with their uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares, nnls
from scipy.stats import chi2, norm, t

from dicflow.core.arrays import Array, Mask
from dicflow.core.material.models import Model
from dicflow.core.material.response import nominal_stress, stress_by_constants, stress_by_stretch

__all__ = ["Curve", "Fit", "fit", "largest_invariant", "relative_errors"]

_LEAST_SHARE = 0.05
"""Errors in proportion to the stress are at least those of this share of the largest stress."""
_SEARCHES = 4
"""Searches with each combination of signs."""
_MOST_STEPS = 100
"""Steps of one search."""
_ROUNDS = 3
"""Fits with weights from the slope of the one before."""


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
    chi2 : weighted sum of squares; in units of the variances if these are known
    misfit_ratio : χ² per degree of freedom; 1 where the residuals are as large as u, NaN if u is unknown
    is_misfit : whether the residuals are larger than u explains (5 % level)
    aicc : Akaike's criterion, corrected for few points; comparable between models of the same curves
    condition : of the weighted sensitivities, each constant in units of its own size
    at_limit : (p,) bool — constants that stopped at a limit of the search; they have no uncertainty
    others : (m, p) — other minima that fit as well, within the noise
    """

    constants: Array
    independent: Array
    common: Array
    factor: float
    errors: tuple[Array, ...]
    chi2: float
    misfit_ratio: float
    is_misfit: bool
    aicc: float
    condition: float
    at_limit: Array
    others: Array

    @property
    def covariance(self) -> Array:
        """Of the constants, all shares together, (p, p)."""
        return self.independent + self.common

    @property
    def correlation(self) -> Array:
        """Of the constants by the independent share, (p, p); NaN for those at a limit."""
        scale = np.sqrt(np.diag(self.independent))
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(self.independent / np.outer(scale, scale))

    @property
    def half_width(self) -> Array:
        """Half the width of each constant's interval of 95 %, (p,); NaN for those at a limit."""
        return self.half_width_of(np.eye(len(self.constants)))

    def half_width_of(self, gradient: Array) -> Array:
        """Half the width of the interval of 95 % of what has this gradient (..., p) by the constants."""
        independent = np.einsum("...i,ij,...j->...", gradient, self.independent, gradient)
        common = np.einsum("...i,ij,...j->...", gradient, self.common, gradient)
        return np.asarray(np.sqrt(self.factor**2 * independent + _NORMAL**2 * common))


_NORMAL = float(norm.ppf(0.975))


def fit(model: Model, curves: Sequence[Curve]) -> Fit:
    """Fit by least squares, each point weighted by its uncertainty, or by its stress where that is unknown.

    Searches begin at many shapes: for each, the constants in units of stress follow linearly, and the best shapes of
    each combination of signs are refined by Levenberg's and Marquardt's method within limits. Of minima that do not
    differ by more than the noise, the one with the smallest pure numbers is taken. Errors of the stretch count with the
    slope of the fitted curve.
    Raises ValueError if there are not more points than constants.
    """
    points, count = sum(len(curve.stress) for curve in curves), len(model.constants)
    if points <= count:
        raise ValueError(f"{points} points for {count} constants; more points than constants are needed")
    sigma = [_sigma(curve) for curve in curves]
    minima = _minima(model, curves, np.concatenate(sigma))
    best, others = _simplest(model, minima, points)
    for _ in range(_ROUNDS if any(curve.u_stretch is not None for curve in curves) else 0):
        sigma = [_with_stretch(model, best, curve, one) for curve, one in zip(curves, map(_sigma, curves), strict=True)]
        best = _refined(model, curves, np.concatenate(sigma), best)[0]
    return _fitted(model, curves, sigma, best, others)


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


def _sigma(curve: Curve) -> Array:
    """Standard deviation of the stress at each point, (n,); in proportion to the stress if unknown."""
    return _scale(curve) if curve.u_stress is None else curve.u_stress


def _with_stretch(model: Model, c: Array, curve: Curve, sigma: Array) -> Array:
    """The standard deviations of the stress, with those of the stretch by the slope of the curve."""
    if curve.u_stretch is None:
        return sigma
    slope = stress_by_stretch(model, c, curve.mode, curve.stretches)
    return np.hypot(sigma, slope * curve.u_stretch)


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
    measured = np.concatenate([curve.stress for curve in curves]) / sigma
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
    measured = np.concatenate([curve.stress for curve in curves])
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


def _simplest(model: Model, minima: Sequence[tuple[float, Array]], points: int) -> tuple[Array, Array]:
    """Of the minima that are as good as the best within the noise, the one with the smallest pure numbers; others."""
    freedom = points - len(model.constants)
    numbers, least = _numbers(model), minima[0][0]
    alike = [c for cost, c in minima if cost <= least * (1.0 + 1.0 / freedom) + 1e-12]
    best = min(alike, key=lambda c: float(np.abs(c[numbers]).max(initial=0.0)))
    others = [c for c in alike if _differ(c, best)]
    return best, np.array(others).reshape(-1, len(model.constants))


def _differ(one: Array, other: Array) -> bool:
    """Whether two minima are different ones; the order of a model's terms does not count."""
    return not np.allclose(np.sort(one), np.sort(other), rtol=0.02, atol=1e-6 * float(np.abs(other).max()))


def _fitted(model: Model, curves: Sequence[Curve], sigma: Sequence[Array], c: Array, others: Array) -> Fit:
    """The fit with its uncertainty at constants ``c``, where the search ended."""
    every = np.concatenate(sigma)
    sensitivity = _jacobian(model, c, curves) / every[:, None]
    residuals = _stresses(model, c, curves) - np.concatenate([curve.stress for curve in curves])
    chi_squared, freedom = float(np.sum((residuals / every) ** 2)), len(every) - len(c)
    least, most = model.limits(c[_numbers(model)], largest_invariant(curves))
    at_limit = _is_near(c, least) | _is_near(c, most)
    is_known = all(curve.u_stress is not None for curve in curves)
    is_misfit = bool(is_known and chi_squared > chi2.ppf(0.95, freedom))
    solver = _solver(sensitivity, at_limit)
    variance = chi_squared / freedom if is_misfit or not is_known else 1.0
    ends = np.cumsum([len(one) for one in sigma])[:-1]
    return Fit(
        constants=c,
        independent=_masked(solver @ solver.T * variance, at_limit),
        common=_masked(_common(model, c, curves, solver / every), at_limit),
        factor=float(t.ppf(0.975, freedom)) if is_misfit or not is_known else _NORMAL,
        errors=tuple(np.split(residuals, ends)),
        chi2=chi_squared,
        misfit_ratio=chi_squared / freedom if is_known else np.nan,
        is_misfit=is_misfit,
        aicc=_aicc(chi_squared, every, len(c)),
        condition=float(np.linalg.cond(sensitivity[:, ~at_limit] * c[~at_limit])),
        at_limit=at_limit,
        others=others,
    )


def _is_near(c: Array, limit: Array) -> Array:
    """Constants at a limit that is not infinite; a stress factor near 0 too."""
    return np.isfinite(limit) & (np.abs(c - limit) <= 1e-4 * np.maximum(np.abs(limit), 1e-6 * np.abs(c).max()))


def _solver(sensitivity: Array, at_limit: Array) -> Array:
    """(JᵀJ)⁻¹Jᵀ of the weighted sensitivities (n, p), without the constants at a limit, whose rows are 0; (p, n)."""
    found = np.zeros(sensitivity.T.shape)
    size = np.linalg.norm(sensitivity[:, ~at_limit], axis=0)
    found[~at_limit] = np.linalg.pinv(sensitivity[:, ~at_limit] / size) / size[:, None]
    return found


def _common(model: Model, c: Array, curves: Sequence[Curve], by_stress: Array) -> Array:
    """Covariance of the constants by errors that all points of a curve share, (p, p). by_stress : ∂c/∂P, (p, n)"""
    ends = np.cumsum([len(curve.stress) for curve in curves])[:-1]
    found = np.zeros((len(c), len(c)))
    for curve, part in zip(curves, np.split(by_stress, ends, axis=1), strict=True):
        slope = stress_by_stretch(model, c, curve.mode, curve.stretches)
        shift = part @ np.stack(
            [curve.stress * curve.common_stress, slope * curve.stretches[:, 0] * curve.common_stretch], axis=1
        )
        found += shift @ shift.T
    return found


def _masked(covariance: Array, at_limit: Array) -> Array:
    """Zero in the rows and columns of constants at a limit."""
    return np.where(at_limit[:, None] | at_limit[None, :], 0.0, covariance)


def _aicc(chi_squared: float, sigma: Array, constants: int) -> float:
    """Akaike's corrected criterion with a common factor of all variances estimated; infinite with too few points."""
    points, estimated = len(sigma), constants + 1
    if points <= estimated + 1:
        return float("inf")
    correction = 2.0 * estimated * (estimated + 1) / (points - estimated - 1)
    deviance = points * np.log(max(chi_squared, 1e-300) / points) + 2.0 * float(np.log(sigma).sum())
    return float(deviance + 2.0 * estimated + correction)
