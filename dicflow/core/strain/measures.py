"""Measures of strain and the other measures of a deformation gradient, with their uncertainty.

With the stretches λ₁ ≥ λ₂, the roots of the eigenvalues of FᵀF, the measures of Seth (1961) and Hill (1968) are
f(λ) along the principal directions:

    green_lagrange (λ² − 1) / 2,   hencky ln λ,   euler_almansi (1 − λ⁻²) / 2,   biot λ − 1.

In ``material`` directions x and y are those of the material in the reference state: the tensor f(U) of F = R U. In
``global`` directions they are the world's at this step: f(V) of F = V R. ``gxy`` is twice the tensor's component.
``engineering`` is not a tensor: the stretch minus 1 of the fibres along x and y, and the decrease of the right angle
between them; in global directions, of the fibres that lie along x and y at this step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.strain.surface_strain import Strain, engineering_strain, tangent_basis
from dicflow.core.tensors import inverse
from dicflow.core.uncertainty.covariance import derivative, sigma_along

__all__ = [
    "ENGINEERING",
    "DeformationMeasures",
    "Directions",
    "GradientFunction",
    "GradientMeasures",
    "StretchFunction",
    "almansi_strain",
    "biot_strain",
    "deformation_measures",
    "green_lagrange_strain",
    "hencky_strain",
    "principal_stretches",
    "strain_components",
    "strain_slope_coefficients",
]

Directions = Literal["material", "global"]
StretchFunction = Callable[[Array], Array]
"""Strain f(λ) of stretches (...); f(1) = 0 and f′(1) = 1."""
GradientFunction = Callable[[Array], Array]
"""A quantity (...) of deformation gradients (..., 2, 2)."""

ENGINEERING: StretchFunction | None = None
"""The measure without a tensor: the strain of fibres."""


def green_lagrange_strain(stretch: Array) -> Array:
    """(λ² − 1) / 2."""
    return (stretch**2 - 1.0) / 2.0


def hencky_strain(stretch: Array) -> Array:
    """ln λ."""
    return np.asarray(np.log(stretch))


def almansi_strain(stretch: Array) -> Array:
    """(1 − λ⁻²) / 2."""
    return (1.0 - stretch**-2.0) / 2.0


def biot_strain(stretch: Array) -> Array:
    """λ − 1."""
    return stretch - 1.0


class DeformationMeasures(NamedTuple):
    """Strains and other measures of the deformation at a point.

    exx, eyy, gxy : (...) — strains of the measure [-]
    e1, e2 : (...) — principal strains of the measure, the larger first [-]
    angle : (...) — of the direction of e1 from x towards y, −90 … 90 [deg]
    rotation : (...) — R of F = R U in the tangent plane, from x towards y [deg]
    von_mises : (...) — equivalent logarithmic strain of an incompressible material, √(4/3 (h₁² + h₁h₂ + h₂²)) with
        h = ln λ, so that in uniaxial tension it is the strain along the load [-]
    area_change : (...) — det F − 1 [-]
    """

    exx: Array
    eyy: Array
    gxy: Array
    e1: Array
    e2: Array
    angle: Array
    rotation: Array
    von_mises: Array
    area_change: Array


class GradientMeasures(NamedTuple):
    """What is computed of deformation gradients.

    strain : measure of strain; None for engineering strain
    directions : in which x and y of the strains lie
    further : name → quantity beside those of :class:`DeformationMeasures`
    """

    strain: StretchFunction | None = ENGINEERING
    directions: Directions = "material"
    further: Mapping[str, GradientFunction] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all quantities, in the order of their derivatives."""
        return (*DeformationMeasures._fields, *self.further)

    def values(self, gradient: Array) -> dict[str, Array]:
        """Each quantity (...) of deformation gradients (..., 2, 2)."""
        measures = deformation_measures(gradient, self.strain, self.directions)
        return {**measures._asdict(), **{name: function(gradient) for name, function in self.further.items()}}

    def sigmas(self, gradient: Array, covariance: Array) -> dict[str, Array]:
        """Standard deviation of each quantity, to first order.

        covariance : (..., 4, 4) — of F₁₁, F₁₂, F₂₁, F₂₂
        That of the angle is large near λ₁ = λ₂, where the principal direction is undefined.
        """
        deviations = sigma_along(covariance[..., None, :, :], self.derivatives(gradient))
        return dict(zip(self.names, np.moveaxis(deviations, -1, 0), strict=True))

    def derivatives(self, gradient: Array) -> Array:
        """Derivatives (..., n, 4) of all quantities, in the order of their names, by F₁₁, F₁₂, F₂₁, F₂₂."""

        def stacked(flat: Array) -> Array:
            return np.stack([*self.values(flat.reshape(*flat.shape[:-1], 2, 2)).values()], axis=-1)

        return derivative(stacked, gradient.reshape(*gradient.shape[:-2], 4))


def deformation_measures(
    gradient: Array, strain: StretchFunction | None = ENGINEERING, directions: Directions = "material"
) -> DeformationMeasures:
    """All measures of deformation gradients (..., 2, 2)."""
    large, small, angle = principal_stretches(gradient, directions)
    h1, h2 = np.log(large), np.log(small)
    of_stretch = strain or biot_strain
    return DeformationMeasures(
        *strain_components(gradient, strain, directions),
        of_stretch(large),
        of_stretch(small),
        np.degrees(angle),
        np.degrees(np.arctan2(gradient[..., 1, 0] - gradient[..., 0, 1], gradient[..., 0, 0] + gradient[..., 1, 1])),
        np.sqrt(4.0 / 3.0 * (h1**2 + h1 * h2 + h2**2)),
        large * small - 1.0,
    )


def strain_slope_coefficients(
    gradient: Array, reference: Array, strain: StretchFunction | None, directions: Directions
) -> Strain:
    """Coefficients (4, 2) of the slopes, per column and per row, in the errors of exx, eyy and gxy.

    gradient : (2, 2) — F
    reference : (3, 2) — slopes J of the surface in the reference state
    Row by row, the coefficients multiply errors along x and y of the deformed and then of the reference tangent plane,
    which are independent and equally large; errors normal to the planes have no effect.
    """

    def stacked(flat: Array) -> Array:
        return np.stack(strain_components(flat.reshape(*flat.shape[:-1], 2, 2), strain, directions), axis=-1)

    flat = inverse(tangent_basis(reference).T @ reference)
    by_gradient = derivative(stacked, gradient.reshape(4)).reshape(3, 2, 2)
    moved = by_gradient @ flat.T
    fixed = -np.swapaxes(gradient, -1, -2) @ moved
    return Strain(*np.concatenate([moved, fixed], axis=1))


def strain_components(gradient: Array, strain: StretchFunction | None, directions: Directions) -> Strain:
    """Strains of a measure along x and y, and the shear, from deformation gradients (..., 2, 2)."""
    if strain is None:
        return engineering_strain(gradient) if directions == "material" else _strain_of_present_fibres(gradient)
    large, small, angle = principal_stretches(gradient, directions)
    f1, f2 = strain(large), strain(small)
    mean, half = (f1 + f2) / 2.0, (f1 - f2) / 2.0
    return Strain(mean + half * np.cos(2 * angle), mean - half * np.cos(2 * angle), 2.0 * half * np.sin(2 * angle))


def principal_stretches(gradient: Array, directions: Directions) -> tuple[Array, Array, Array]:
    """Principal stretches λ₁ ≥ λ₂ and the angle of λ₁'s direction from x [rad], each (...).

    In material directions the angle is that in the reference state, in global ones that at this step. NaN where
    det F ≤ 0.
    """
    transposed = np.swapaxes(gradient, -1, -2)
    square = transposed @ gradient if directions == "material" else gradient @ transposed
    xx, yy, xy = square[..., 0, 0], square[..., 1, 1], square[..., 0, 1]
    determinant = gradient[..., 0, 0] * gradient[..., 1, 1] - gradient[..., 0, 1] * gradient[..., 1, 0]
    determinant = np.where(determinant > 0.0, determinant, np.nan)
    large = np.sqrt((xx + yy) / 2.0 + np.hypot((xx - yy) / 2.0, xy))
    return large + 0.0 * determinant, determinant / large, 0.5 * np.arctan2(2.0 * xy, xx - yy)


def _strain_of_present_fibres(gradient: Array) -> Strain:
    """Engineering strain of the fibres that lie along x and y at this step, from that of F⁻¹."""
    with np.errstate(invalid="ignore"):
        backward = engineering_strain(inverse(gradient))
    return Strain(1.0 / (1.0 + backward.exx) - 1.0, 1.0 / (1.0 + backward.eyy) - 1.0, -backward.gxy)
