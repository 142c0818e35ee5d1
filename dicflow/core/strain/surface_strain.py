"""Strain: deformation gradients of a curved surface, engineering strains, and the thesis's quotients of differences.

A surface X(i, j) over material indices (row i, column j) has the Jacobian J = [∂X/∂j, ∂X/∂i]. In its tangent plane,
the basis B = [e₁, e₂] follows the world: e₁ is the world's X projected on the plane, e₂ is normal to it and points
along the world's Y. The deformation gradient from one step to the next is f = (B'ᵀJ')(BᵀJ)⁻¹, the gradients of
successive steps compose, F = fₖ ⋯ f₂ f₁, and engineering strain is the change of length per length along e₁ and e₂.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array
from dicflow.core.surfaces.filters import local_polynomial
from dicflow.core.surfaces.surface import evaluate, fit_surface
from dicflow.core.tensors import cross, inverse, product

__all__ = [
    "Strain",
    "deformation_gradient",
    "engineering_strain",
    "jacobian",
    "tangent_basis",
    "thesis_strain",
]


class Strain(NamedTuple):
    """Strain in the plane of the surface; NaN where unknown.

    exx, eyy : (...) — stretch minus 1 of the directions that were x and y
    gxy : (...) — shear: decrease of the angle between them [rad]
    """

    exx: Array
    eyy: Array
    gxy: Array


def jacobian(
    xyz: ArrayLike, window: tuple[int, int], degree: int, weights: ArrayLike | None = None, min_share: float = 0.0
) -> Array:
    """Derivatives of a surface along its grid, from local polynomials.

    xyz : (row, col, 3) [mm]
    window : (rows, cols), odd numbers of points
    weights : (row, col) — of each point
    min_share : share of a window's points that must have a value; at least 1.5 per coefficient in any case
    Returns (row, col, 3, 2): per column and per row; NaN where the point or too much of its window is missing.
    """
    points = np.asarray(xyz, dtype=np.float64)
    coefficients = (degree + 1) * (degree + 2) / 2.0
    margin = max(1.5, min_share * window[0] * window[1] / coefficients)
    fit = local_polynomial(points, window, degree, weights=weights, margin=margin)
    derivatives = np.stack([fit.d_col, fit.d_row], axis=-1)
    derivatives[np.isnan(points).any(axis=-1)] = np.nan
    return derivatives


def tangent_basis(derivatives: Array) -> Array:
    """Orthonormal basis of the tangent planes.

    derivatives : (..., 3, 2) — two directions in each plane
    Returns (..., 3, 2): e₁ and e₂ in columns; NaN where the two directions are parallel or X is normal to the plane.
    """
    normal = cross(derivatives[..., 0], derivatives[..., 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        normal = normal * np.where(normal[..., 2:] < 0.0, -1.0, 1.0)
        first = np.array([1.0, 0.0, 0.0]) - normal[..., :1] * normal
        first = first / np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, cross(normal, first)], axis=-1)


def deformation_gradient(before: Array, after: Array) -> Array:
    """Gradient of the deformation between two states of a surface, each in its own tangent basis.

    before, after : (..., 3, 2) — derivatives along the same material indices
    Returns (..., 2, 2) [-]; NaN where either is missing or the indices do not span the plane.
    """
    reference = np.swapaxes(tangent_basis(before), -1, -2) @ before
    deformed = np.swapaxes(tangent_basis(after), -1, -2) @ after
    with np.errstate(invalid="ignore"):
        return product(deformed, inverse(reference))


def engineering_strain(gradient: Array) -> Strain:
    """Engineering strain from a deformation gradient (..., 2, 2).

    εx = |F e₁| − 1, εy = |F e₂| − 1, γxy = asin(F e₁ · F e₂ / (|F e₁| |F e₂|)); a rotation gives 0.
    """
    first, second = gradient[..., 0], gradient[..., 1]
    stretch_x, stretch_y = np.linalg.norm(first, axis=-1), np.linalg.norm(second, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = (first * second).sum(axis=-1) / (stretch_x * stretch_y)
    return Strain(stretch_x - 1.0, stretch_y - 1.0, np.arcsin(np.clip(cosine, -1.0, 1.0)))


def thesis_strain(displacement: Array, xyz_reference: Array, window: tuple[int, int], degree: int) -> Strain:
    """Strain of one increment as the thesis defines it (§3.2.9), on a regular pixel grid of the deformed state.

    εxx = Δₓdx / Δₓx, εyy = Δᵧdy / Δᵧy, γxy = Δₓdy / Δₓx + Δᵧdx / Δᵧy, where Δₓ and Δᵧ are differences between
    neighbouring columns and rows; those of the coordinates are replaced by planes, those of the displacement smoothed.

    displacement : (row, col, 2 or more) — dx, dy [mm]
    xyz_reference : (row, col, 3) — coordinates before the increment, stretched to the grid [mm]
    window, degree : of the local polynomials that smooth the differences

    The thesis's script replaces each window of its field by the fit before the next one, so that its result depends on
    the order; here every window contains the original differences.
    Raises ValueError where too few points are valid for a plane.
    """
    spacing_x = _plane(_difference(xyz_reference[..., 0], axis=1))
    spacing_y = _plane(_difference(xyz_reference[..., 1], axis=0))
    along_x = local_polynomial(_difference(displacement[..., :2], axis=1), window, degree).value
    along_y = local_polynomial(_difference(displacement[..., :2], axis=0), window, degree).value
    missing = np.isnan(displacement[..., :2]).any(axis=-1)
    measures = (
        along_x[..., 0] / spacing_x,
        along_y[..., 1] / spacing_y,
        along_x[..., 1] / spacing_x + along_y[..., 0] / spacing_y,
    )
    return Strain(*(np.where(missing, np.nan, measure) for measure in measures))


def _difference(field: Array, axis: int) -> Array:
    """Each column (axis 1) or row (axis 0) minus the previous one; NaN at the first."""
    gap = np.full_like(np.take(field, [0], axis=axis), np.nan)
    return np.concatenate([gap, np.diff(field, axis=axis)], axis=axis)


def _plane(field: Array) -> Array:
    """The least-squares plane of a field (row, col)."""
    rows, cols = field.shape
    return evaluate(fit_surface(field, (1, 1)), np.arange(cols), np.arange(rows))
