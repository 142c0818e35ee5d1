"""Surfaces z(x, y) fitted to a field: polynomials and local regression, robust against outliers.

The field is a grid with holes (NaN); x is the column and y the row, centred and scaled to −1 … 1 over what is valid.
A polynomial of degree (p, q) has the terms xⁱ yʲ with i ≤ p, j ≤ q and i + j ≤ max(p, q), here as products of Legendre
polynomials, which span the same surfaces and keep the normal equations well conditioned. On a grid these equations
separate, so a solution costs two matrix products.

Robust fits are least squares with weights that follow from the residuals r, repeated until the surface converges
(Holland & Welsch 1977, Commun. Stat. Theory Methods 6:813), with the scale s = median|r| / 0.6745:
bisquare w = (1 − (r / 4.685 s)²)², 0 beyond; LAR, the least sum of |r|, w = 1 / max(|r|, 0.01 s).
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array, Mask
from dicflow.core.surfaces.filters import local_polynomial

__all__ = [
    "DegreeChoice",
    "Lowess",
    "Quality",
    "Robust",
    "Surface",
    "choose_degree",
    "evaluate",
    "fit_lowess",
    "fit_surface",
    "polynomial_terms",
    "quality",
]

Robust = Literal["none", "lar", "bisquare"]

_MAD_PER_SIGMA = 0.6745
_BISQUARE_CUTOFF = 4.685
_LAR_MIN_RESIDUAL = 0.01
_CONVERGED_SHARE = 1e-3
"""A robust fit has converged when every point of the surface moves by less than this share of the scale s."""
_MAX_SOLUTIONS = 50
_LOWESS_SOLUTIONS = 4
_ROUNDING_SHARE = 1e-11
"""Rounding error as a share of the largest value: the least scale s."""
_MIN_CORRELATION = 0.05
_MAX_DEGREE = 5


class Quality(NamedTuple):
    """Goodness of fit of a surface, with the weights w of its points; n = Σw (thesis, §3.2.6).

    Bisquare weights reduce normal noise too: the RMSE is 0.910 of its standard deviation.

    sse : Σ w (z − ẑ)²
    r2 : Σ w (ẑ − z̄)² / Σ w (z − z̄)², z̄ the weighted mean
    adjusted_r2 : 1 − (SSE / (n − coefficients)) / (SST / (n − 1))
    rmse : √(SSE / (n − coefficients))
    """

    sse: float
    r2: float
    adjusted_r2: float
    rmse: float


class Surface(NamedTuple):
    """A fitted polynomial.

    coefficients : (p + 1, q + 1) of the Legendre products; 0 where a term is left out
    centre, half : (x, y) of the centre, and half the size, of the box around the valid points [points]
    weights : (row, col) — of every point in the last solution; 0 at holes; with LAR their mean is 1 elsewhere
    solutions : number of least-squares solutions
    converged : whether a robust fit converged
    quality : of the fit on all points
    """

    coefficients: Array
    centre: tuple[float, float]
    half: tuple[float, float]
    weights: Array
    solutions: int
    converged: bool
    quality: Quality


class DegreeChoice(NamedTuple):
    """A chosen degree, the same in x and y.

    reason : explanation in one sentence
    """

    degree: int
    reason: str


class Lowess(NamedTuple):
    """A local regression.

    values : (row, col) — NaN where the window holds too few points
    weights : (row, col) — of every point; 0 at holes
    quality : with the trace of the smoother as the number of coefficients
    """

    values: Array
    weights: Array
    quality: Quality


class _Basis(NamedTuple):
    """Legendre polynomials at the columns (col, p + 1) and rows (row, q + 1), and which products are terms."""

    across: Array
    down: Array
    used: Mask


class _RobustSolution(NamedTuple):
    """Result of a robust fit."""

    coefficients: Array
    scale: float
    solutions: int
    converged: bool


def polynomial_terms(degree: tuple[int, int]) -> Mask:
    """Which terms xⁱ yʲ a surface of a degree (p, q) has; (p + 1, q + 1)."""
    i, j = np.indices((degree[0] + 1, degree[1] + 1))
    return np.asarray(i + j <= max(degree))


def fit_surface(
    values: ArrayLike, degree: tuple[int, int], robust: Robust = "none", max_points: int = 50_000
) -> Surface:
    """Fit a polynomial surface to a field with holes.

    values : (row, col)
    degree : (p, q) in x = column and y = row
    max_points : a robust fit iterates on a regular subset of at most about this many points; one last solution uses all
        points, with the weights by the surface of the subset

    Without outlier weights SSE cannot grow with the degree, because the surfaces are nested. With them it can grow a
    little, because every degree has its own outliers.
    Raises ValueError where fewer points than coefficients are valid.
    """
    field, valid = _without_holes(values)
    terms = polynomial_terms(degree)
    if np.count_nonzero(valid) < np.count_nonzero(terms):
        raise ValueError(
            f"a surface of degree {degree[0]} × {degree[1]} has {np.count_nonzero(terms)} coefficients, "
            f"but only {np.count_nonzero(valid)} points have a value"
        )
    centre, half = _valid_box(valid)
    basis = _basis(np.arange(valid.shape[1]), np.arange(valid.shape[0]), centre, half, terms)
    weights, robust_solution = valid.astype(np.float64), _RobustSolution(np.zeros(0), 0.0, 0, True)
    if robust != "none":
        robust_solution = _robust_solution(basis, field, valid, robust, _stride(valid, max_points))
        weights = _outlier_weights(
            (field - _surface_values(basis, robust_solution.coefficients)) / robust_solution.scale, valid, robust
        )
    coefficients = _solve(basis, field, weights)
    fit = quality(field, _surface_values(basis, coefficients), weights, int(np.count_nonzero(terms)))
    return Surface(coefficients, centre, half, weights, robust_solution.solutions + 1, robust_solution.converged, fit)


def evaluate(surface: Surface, x: ArrayLike, y: ArrayLike) -> Array:
    """Values (row, col) of a surface on the grid of columns x (col,) and rows y (row,), also beyond its points."""
    terms = np.ones(surface.coefficients.shape, dtype=np.bool_)
    return _surface_values(_basis(x, y, surface.centre, surface.half, terms), surface.coefficients)


def quality(values: Array, fitted: Array, weights: Array, coefficients: float) -> Quality:
    """Statistics of a fit; arrays (row, col), finite where the weight is not 0."""
    used = weights > 0.0
    z, surface, w = values[used], fitted[used], weights[used]
    count = float(w.sum())
    mean = float((w * z).sum()) / count  # a dot product would depend on the number of threads
    sse, ssr, sst = (float((w * difference**2).sum()) for difference in (z - surface, surface - mean, z - mean))
    freedom = max(count - coefficients, 1.0)
    if sst == 0.0:
        return Quality(sse, 1.0, 1.0, (sse / freedom) ** 0.5)
    adjusted = 1.0 - (sse / freedom) / (sst / max(count - 1.0, 1.0))
    return Quality(sse, ssr / sst, adjusted, (sse / freedom) ** 0.5)


def choose_degree(values: ArrayLike, robust: Robust = "none", max_points: int = 50_000) -> DegreeChoice:
    """Choose the degree of a polynomial surface among 1 … 5 by the Bayesian information criterion.

    BIC = N ln(SSE / n) + coefficients · ln N (Schwarz 1978, Ann. Stat. 6:461). The errors of neighbouring points of a
    dense field are correlated, so N is the number of independent points: N = n / A with A the area over which the
    residuals of degree 5 are correlated. All degrees are compared with the outlier weights of degree 5, so that SSE
    cannot grow with the degree.

    values : (row, col), NaN at holes
    Raises ValueError where fewer points than coefficients of degree 5 are valid.
    """
    full_field = np.asarray(values, dtype=np.float64)
    step = _stride(np.isfinite(full_field), max_points)
    field = full_field[::step, ::step]
    richest = fit_surface(field, (_MAX_DEGREE, _MAX_DEGREE), robust, max_points)
    zeroed, valid = _without_holes(field)
    residual = zeroed - evaluate(richest, np.arange(valid.shape[1]), np.arange(valid.shape[0]))
    area = _correlated_area(residual, richest.weights > 0.0)
    independent = max(float(richest.weights.sum()) / area, 1.0)
    floor = (_ROUNDING_SHARE * np.abs(zeroed).max()) ** 2
    variances, criteria = [], []
    for degree in range(1, _MAX_DEGREE + 1):
        terms = polynomial_terms((degree, degree))
        basis = _basis(np.arange(valid.shape[1]), np.arange(valid.shape[0]), richest.centre, richest.half, terms)
        fitted = _surface_values(basis, _solve(basis, zeroed, richest.weights))
        sse = float((richest.weights * (zeroed - fitted) ** 2).sum())
        variances.append(max(sse / float(richest.weights.sum()), floor))
        criteria.append(independent * np.log(variances[-1]) + np.count_nonzero(terms) * np.log(independent))
    degree = int(np.argmin(criteria)) + 1
    gain = 1.0 - (min(variances) / variances[degree - 1]) ** 0.5
    reason = (
        f"degree {degree} of 1…{_MAX_DEGREE} has the lowest BIC with {independent:.0f} independent points "
        f"(residuals are correlated over {area * step**2:.0f} points); "
        f"degree {_MAX_DEGREE} would lower the RMSE by {100.0 * gain:.2g} %"
    )
    return DegreeChoice(degree, reason)


def fit_lowess(values: ArrayLike, window: tuple[int, int], degree: int = 1, robust: Robust = "none") -> Lowess:
    """Smooth a field by local regression with tricube weights (Cleveland 1979); a robust one repeats it 3 times.

    values : (row, col)
    window : (rows, cols), odd numbers of points
    degree : 1 linear, 2 quadratic
    Raises ValueError where no window holds enough points.
    """
    field, valid = _without_holes(values)
    holed: Array = np.where(valid, field, np.nan)
    weights = valid.astype(np.float64)
    local = local_polynomial(holed, window, degree, kernel="tricube")
    if np.isnan(local.value).all():
        raise ValueError(f"no window of {window[0]} × {window[1]} holds enough points for degree {degree}")
    for _ in range(_LOWESS_SOLUTIONS - 1 if robust != "none" else 0):
        known = np.logical_and(valid, np.isfinite(local.value))
        residual: Array = np.where(known, field - local.value, 0.0)
        weights = _outlier_weights(residual / _scale(residual, known, field), known, robust)
        local = local_polynomial(holed, window, degree, kernel="tricube", weights=weights)
    weights = np.where(np.isfinite(local.value), weights, 0.0)
    trace = float(np.nansum(local.leverage))
    return Lowess(local.value, weights, quality(field, local.value, weights, trace))


def _without_holes(values: ArrayLike) -> tuple[Array, Mask]:
    """The field with 0 at its holes, and which points are valid."""
    field = np.asarray(values, dtype=np.float64)
    valid: Mask = np.asarray(np.isfinite(field))
    return np.where(valid, field, 0.0), valid


def _valid_box(valid: Mask) -> tuple[tuple[float, float], tuple[float, float]]:
    """Centre and half size (x, y) of the box around the valid points."""
    spans = [np.flatnonzero(valid.any(axis=axis))[[0, -1]] for axis in (0, 1)]
    (x0, x1), (y0, y1) = spans
    return ((x0 + x1) / 2.0, (y0 + y1) / 2.0), (max((x1 - x0) / 2.0, 0.5), max((y1 - y0) / 2.0, 0.5))


def _basis(x: ArrayLike, y: ArrayLike, centre: tuple[float, float], half: tuple[float, float], used: Mask) -> _Basis:
    """The basis at columns x and rows y, scaled to −1 … 1 over ``centre`` ± ``half``; used : which terms to keep."""
    across, down = (
        np.asarray(legendre.legvander((np.asarray(places, np.float64) - middle) / size, count - 1), np.float64)
        for places, middle, size, count in zip((x, y), centre, half, used.shape, strict=True)
    )
    return _Basis(across, down, used)


def _surface_values(basis: _Basis, coefficients: Array) -> Array:
    """Values (row, col) of a surface on the grid of a basis."""
    return np.asarray(np.einsum("rq,qc->rc", basis.down, coefficients.T @ basis.across.T))


def _solve(basis: _Basis, field: Array, weights: Array) -> Array:
    """Coefficients of weighted least squares; field and weights (row, col), finite.

    Long sums use einsum, because the order of summation of a matrix product depends on the number of threads.
    """
    (cols, p), (rows, q) = basis.across.shape, basis.down.shape
    across = (basis.across[:, :, None] * basis.across[:, None, :]).reshape(cols, p * p)
    down = (basis.down[:, :, None] * basis.down[:, None, :]).reshape(rows, q * q)
    moments = np.einsum("rj,rk->jk", down, _sums_along_rows(weights, across))
    normal = moments.reshape(q, q, p, p).transpose(2, 0, 3, 1)[basis.used][:, basis.used]
    right = np.einsum("rp,rq->pq", _sums_along_rows(weights * field, basis.across), basis.down)[basis.used]
    coefficients = np.zeros((p, q))
    coefficients[basis.used] = np.linalg.lstsq(normal, right, rcond=1e-13)[0]
    return coefficients


def _sums_along_rows(values: Array, functions: Array) -> Array:
    """Σ over the columns of values (row, col) times functions (col, k); (row, k)."""
    return np.asarray(np.einsum("rc,kc->rk", values, np.ascontiguousarray(functions.T)))


def _stride(valid: Mask, max_points: int) -> int:
    """Step between the rows and columns to keep, so that at most about ``max_points`` valid points remain."""
    return max(1, int(np.ceil(np.sqrt(np.count_nonzero(valid) / max_points))))


def _robust_solution(basis: _Basis, field: Array, valid: Mask, robust: Robust, stride: int) -> _RobustSolution:
    """Solutions with outlier weights until the surface converges, on every ``stride``-th row and column."""
    part = _Basis(basis.across[::stride], basis.down[::stride], basis.used)
    z, known = field[::stride, ::stride], valid[::stride, ::stride]
    coefficients = _solve(part, z, known.astype(np.float64))
    for solutions in range(1, _MAX_SOLUTIONS):
        residual = z - _surface_values(part, coefficients)
        scale = _scale(residual, known, z)
        before = coefficients
        coefficients = _solve(part, z, _outlier_weights(residual / scale, known, robust))
        if np.abs(coefficients - before).sum() <= _CONVERGED_SHARE * scale:
            return _RobustSolution(coefficients, scale, solutions + 1, True)
    return _RobustSolution(coefficients, scale, _MAX_SOLUTIONS, False)


def _scale(residual: Array, valid: Mask, field: Array) -> float:
    """Robust standard deviation of the residuals, at least the rounding error."""
    return max(
        float(np.median(np.abs(residual[valid]))) / _MAD_PER_SIGMA, _ROUNDING_SHARE * float(np.abs(field).max()), 1e-300
    )


def _outlier_weights(relative: Array, valid: Mask, robust: Robust) -> Array:
    """Weights (row, col) from residuals over their scale; 0 at holes."""
    if robust == "bisquare":
        weights = np.clip(1.0 - (relative / _BISQUARE_CUTOFF) ** 2, 0.0, None) ** 2 * valid
    else:
        weights = valid / np.maximum(np.abs(relative), _LAR_MIN_RESIDUAL)
        weights /= weights[valid].mean()
    return np.asarray(weights)


def _correlated_area(residual: Array, valid: Mask) -> float:
    """Correlated area of the residuals [points]: the product of Σ ρ(lag) over all lags along rows and along columns."""
    zeroed: Array = np.where(valid, residual, 0.0)
    return _correlated_length(zeroed, valid) * _correlated_length(zeroed.T, valid.T)


def _correlated_length(residual: Array, valid: Mask) -> float:
    """Sum of the correlation along the first axis over all lags, up to the first below 0.05 [points]."""
    variance = float((residual**2).sum()) / max(int(np.count_nonzero(valid)), 1)
    length = 1.0
    for lag in range(1, residual.shape[0] // 4 if variance > 0.0 else 0):
        pairs = max(int(np.count_nonzero(valid[lag:] & valid[:-lag])), 1)
        correlation = float((residual[lag:] * residual[:-lag]).sum()) / pairs / variance
        if correlation < _MIN_CORRELATION:
            break
        length += 2.0 * correlation
    return length
