"""Deformed specimens in closed form: positions of material points, and the deformation gradient there.

Material points (X, Y) [mm] lie on a flat strip at rest: X across it, 0 at its middle; Y along it, 0 at the upper and
``length`` at the lower edge of the speckled region. With the mean stretch λ, the local one is

    s(Y) = λ + (λ − 1) a cos(πY/L),

whose integral over [0, L] is λL for every inhomogeneity a, so that the deformed length is exact::

    y = λY + (λ − 1) a (L/π) sin(πY/L)
    x = X s(Y)^(−c) + γ y
    z = b sin(πY/L) + q (2X/W)²

and the position in space is R (x, y, z) + t.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array
from dicflow.core.kernels import KERNEL

__all__ = [
    "Deformation",
    "Strain",
    "gradient",
    "moved_rigidly",
    "position",
    "strain",
    "surface_kernel",
    "tangents_kernel",
]

_Number = TypeVar("_Number", float, Array)


class Deformation(NamedTuple):
    """A deformed state of a strip and its pose; the defaults are the undeformed strip.

    length, width : of the speckled region at rest, L and W [mm]
    stretch : mean stretch λ along the strip [-]
    contraction : exponent c of the lateral contraction; 1/2 keeps an incompressible strip's volume [-]
    inhomogeneity : a, amplitude of the local stretch relative to λ − 1 [-]
    shear : γ, simple shear across the strip [-]
    bulge, curl : heights b and q out of the plane, along and across the strip [mm]
    rotation, translation : (3, 3) and (3,) [mm] — strip's frame to camera frame
    """

    length: float
    width: float
    stretch: float = 1.0
    contraction: float = 0.5
    inhomogeneity: float = 0.0
    shear: float = 0.0
    bulge: float = 0.0
    curl: float = 0.0
    rotation: Array = np.eye(3)
    translation: Array = np.zeros(3)


class Strain(NamedTuple):
    """Engineering strain of the fibres along X and Y, each (...) [-].

    exx, eyy : stretch − 1
    gxy : decrease of the angle between the two [rad]
    """

    exx: Array
    eyy: Array
    gxy: Array


def moved_rigidly(deformation: Deformation, rotation: ArrayLike, translation: ArrayLike) -> Deformation:
    """The same state after a rigid motion p → rotation @ p + translation, or in a frame with that relation."""
    rotation = np.asarray(rotation, dtype=float)
    return deformation._replace(
        rotation=rotation @ deformation.rotation,
        translation=rotation @ deformation.translation + np.asarray(translation, dtype=float),
    )


def position(deformation: Deformation, material: ArrayLike) -> Array:
    """Positions (..., 3) [mm] of material points (..., 2) [mm] in the camera's frame."""
    x, y = np.moveaxis(np.asarray(material, dtype=float), -1, 0)
    local = np.stack(_surface(deformation, x, y), axis=-1)
    return local @ deformation.rotation.T + deformation.translation


def gradient(deformation: Deformation, material: ArrayLike) -> Array:
    """∂position/∂(X, Y) at material points (..., 2): (..., 3, 2) [-], the deformed fibres as columns."""
    x, y = np.moveaxis(np.asarray(material, dtype=float), -1, 0)
    x_x, x_y, y_y, z_x, z_y = np.broadcast_arrays(*_tangents(deformation, x, y))
    along_x = np.stack([x_x, np.zeros_like(x_x), z_x], axis=-1)
    along_y = np.stack([x_y, y_y, z_y], axis=-1)
    return np.asarray(deformation.rotation @ np.stack([along_x, along_y], axis=-1))


def strain(reference: Deformation, deformed: Deformation, material: ArrayLike) -> Strain:
    """Strain at material points (..., 2) from one state to another."""
    before, after = gradient(reference, material), gradient(deformed, material)
    stretch = np.linalg.norm(after, axis=-2) / np.linalg.norm(before, axis=-2)
    return Strain(stretch[..., 0] - 1.0, stretch[..., 1] - 1.0, _fibre_angle(before) - _fibre_angle(after))


def _fibre_angle(fibres: Array) -> Array:
    """Angle between the two fibres (..., 3, 2) [rad]."""
    x, y = fibres[..., 0], fibres[..., 1]
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(x, y), axis=-1), np.sum(x * y, axis=-1)))


def _surface(deformation: Deformation, x: _Number, y: _Number) -> tuple[_Number, _Number, _Number]:
    """The deformed point (x, y, z) in the strip's frame, for arrays and in kernels."""
    wave = np.pi / deformation.length
    excess = (deformation.stretch - 1.0) * deformation.inhomogeneity
    local_stretch = deformation.stretch + excess * np.cos(wave * y)
    along = deformation.stretch * y + excess / wave * np.sin(wave * y)
    across = x * local_stretch ** (-deformation.contraction) + deformation.shear * along
    height = deformation.bulge * np.sin(wave * y) + deformation.curl * (2.0 * x / deformation.width) ** 2
    return across, along, height


def _tangents(deformation: Deformation, x: _Number, y: _Number) -> tuple[_Number, _Number, _Number, _Number, _Number]:
    """∂x/∂X, ∂x/∂Y, ∂y/∂Y, ∂z/∂X and ∂z/∂Y of :func:`_surface` (∂y/∂X is 0)."""
    wave = np.pi / deformation.length
    excess = (deformation.stretch - 1.0) * deformation.inhomogeneity
    local_stretch = deformation.stretch + excess * np.cos(wave * y)
    narrowing = local_stretch ** (-deformation.contraction)
    slope = deformation.contraction * narrowing / local_stretch * excess * wave * np.sin(wave * y)
    return (
        narrowing,
        x * slope + deformation.shear * local_stretch,
        local_stretch,
        8.0 * deformation.curl * x / deformation.width**2,
        deformation.bulge * wave * np.cos(wave * y),
    )


surface_kernel = njit(**KERNEL)(_surface)
tangents_kernel = njit(**KERNEL)(_tangents)
