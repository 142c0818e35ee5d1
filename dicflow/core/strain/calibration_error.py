"""Uncertainty of points, displacement and strain by that of the calibration.

A point X is triangulated where its reprojection errors e (4,) are smallest
(:mod:`dicflow.core.cameras.triangulate`): there Jᵀe = 0 with J = ∂e/∂X (4, 3), and the theorem of implicit functions
gives, for errors much smaller than the photograph,

    ∂X/∂θ = −(JᵀJ)⁻¹ Jᵀ ∂e/∂θ

for the rig's 24 parameters θ at fixed pixels. One rig measures all points and steps, so its errors are common to them:
a few independent modes, each of which moves all points. The error of a displacement is the difference of a point's
motion between two states, that of a strain how the motion varies from point to point, that of a mean or a length the
sum over its points; the share in σ is the root of the sum of squares over the modes.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array, Mask
from dicflow.core.cameras.camera import Rig
from dicflow.core.cameras.frames import Frame
from dicflow.core.cameras.rig_parameters import error_modes, reprojection_slopes
from dicflow.core.strain.gradient_response import gradient_and_response
from dicflow.core.strain.measures import GradientMeasures

__all__ = [
    "MotionError",
    "RigError",
    "field_changes",
    "motion_error",
    "nearest_on_grid",
    "place_changes",
    "point_sensitivity",
    "rig_error",
    "slope_changes",
    "thinned_grid",
]


_MIN_POINTS = 2000
_MIN_POINTS_ACROSS = 12
"""Points that a thinned grid keeps, in all and along its shorter side."""


def point_sensitivity(rig: Rig, points: ArrayLike) -> Array:
    """Derivatives of triangulated points by the rig's parameters at fixed pixels.

    points : (..., 3) — in the left camera's frame [mm]
    Returns (..., 3, 24) — ∂X/∂θ, mm per unit of each of :data:`~dicflow.core.cameras.rig_parameters.PARAMETERS`; NaN
    where a point is NaN.
    """
    by_point, by_rig = reprojection_slopes(rig, np.asarray(points, dtype=float))
    transposed = np.swapaxes(by_point, -1, -2)
    return np.asarray(-np.linalg.solve(transposed @ by_point, transposed @ by_rig))


class MotionError(NamedTuple):
    """Change, by each mode, of the rigid-body motion that is fitted to the points.

    centre : (3,) — of the points [mm]
    turn, shift : (3, m) — small rotation [rad], and translation of the centre [mm]
    """

    centre: Array
    turn: Array
    shift: Array

    def changes_at(self, points: Array) -> Array:
        """Motion (..., 3, m) of points (..., 3) by each mode [mm]."""
        return np.asarray(np.cross(self.turn, (points - self.centre)[..., None], axis=-2) + self.shift)


class RigError(NamedTuple):
    """A rig, and its error.

    modes : (24, m) — independent errors of its parameters, see :func:`error_modes`
    frames : of the points at the step, and of those at the reference state
    motion : change of the rigid-body motion that was subtracted from the step; None where none was subtracted
    """

    rig: Rig
    modes: Array
    frames: tuple[Frame, Frame]
    motion: MotionError | None = None

    def changes_at(self, deformed: Array, reference: Array) -> Array:
        """Change of a point at the step and at the reference state by each mode, (..., 6, m) [mm].

        deformed, reference : (..., 3) — in ``frames`` [mm]
        """
        moved, fixed = (
            frame.rotation @ point_sensitivity(self.rig, points @ frame.rotation + frame.origin) @ self.modes
            for points, frame in zip((deformed, reference), self.frames, strict=True)
        )
        if self.motion is not None:
            moved = moved - self.motion.changes_at(deformed)
        return np.concatenate([moved, fixed], axis=-2)


def rig_error(
    rig: Rig, covariance: ArrayLike, frames: tuple[Frame, Frame], fitted: tuple[Array, Array] | None = None
) -> RigError:
    """The error of a rig from the covariance (24, 24) of its parameters.

    fitted : (..., 3) twice — points at the step and at the reference state to which the subtracted rigid-body motion
        was fitted; None where none was subtracted
    """
    error = RigError(rig, error_modes(covariance), frames)
    return error if fitted is None else error._replace(motion=motion_error(*fitted, error.changes_at(*fitted)))


def motion_error(deformed: Array, reference: Array, changes: Array) -> MotionError:
    """Change of the rigid-body motion fitted to points (:mod:`dicflow.core.cameras.rigid`) when the points change.

    With the points y and x from their centres, the best rotation makes S = Σ y xᵀ symmetric. Changes of y and x change
    S by A = Σ (δy xᵀ + y δxᵀ), and the rotation ω that makes it symmetric again solves
    (tr S · I − S) ω = axial (A − Aᵀ).

    deformed, reference : (..., 3) — with the motion subtracted; points with NaN are ignored
    changes : (..., 6, m) — of both, by each mode
    """
    count = changes.shape[-1]
    y, x = deformed.reshape(-1, 3), reference.reshape(-1, 3)
    known = np.isfinite(y + x).all(axis=1)
    if not known.any():
        return MotionError(np.zeros(3), np.zeros((3, count)), np.zeros((3, count)))
    centre = y[known].mean(axis=0)
    y, x, changes = y[known] - centre, x[known] - x[known].mean(axis=0), changes.reshape(-1, 6, count)[known]
    shift = (changes[:, :3] - changes[:, 3:]).mean(axis=0)
    product = y.T @ x
    change = np.einsum("nim,nj->ijm", changes[:, :3], x) + np.einsum("ni,njm->ijm", y, changes[:, 3:])
    axial = np.stack([change[2, 1] - change[1, 2], change[0, 2] - change[2, 0], change[1, 0] - change[0, 1]])
    return MotionError(centre, np.linalg.pinv(np.trace(product) * np.eye(3) - product) @ axial, shift)


def slope_changes(changes: Array, stride: int = 1) -> Array:
    """Changes of the slopes of the surface by each mode, (row, col, 2, 6, m), per column and per row.

    changes : (row, col, 6, m) — of the points, on the grid or on every ``stride``-th of its rows and columns
    """
    return np.stack([_slope(changes, axis) for axis in (1, 0)], axis=-3) / stride


def field_changes(
    changes: Array, slopes: Array, gradient: Array, response: Array, measures: GradientMeasures
) -> dict[str, Array]:
    """Changes of X, Y, Z, U, V, W and the measures of deformation by each mode, (..., m) each.

    changes, slopes : (..., 6, m) and (..., 2, 6, m) — changes of the points and of the surface's slopes
    gradient, response : (..., 2, 2) and (..., 4, 2, 6) — F, and its derivatives by the slopes;
        :class:`~dicflow.core.strain.deformation_gradient.SurfaceGradient` has both
    """
    change = np.einsum("...fai,...aim->...fm", response, slopes, optimize=True)
    moved = measures.derivatives(gradient) @ change
    return {
        **{name: changes[..., axis, :] for axis, name in enumerate("XYZ")},
        **{name: changes[..., axis, :] - changes[..., axis + 3, :] for axis, name in enumerate("UVW")},
        **{name: moved[..., row, :] for row, name in enumerate(measures.names)},
    }


def place_changes(
    error: RigError, points: tuple[Array, Array], slopes: tuple[Array, Array], measures: GradientMeasures
) -> dict[str, Array]:
    """The same changes at single places, (n, m) each.

    points, slopes : (n, 3) and (n, 3, 2) — of the surface at the step and at the reference state
    """
    steps = [0.5 * np.swapaxes(part, -1, -2) for part in slopes]
    ahead, back = (
        error.changes_at(*(places[:, None] + sign * step for places, step in zip(points, steps, strict=True)))
        for sign in (1.0, -1.0)
    )
    after, before = slopes
    gradient, response = gradient_and_response(before, after)
    return field_changes(error.changes_at(*points), ahead - back, gradient, response, measures)


def thinned_grid(known: Mask) -> tuple[slice, slice]:
    """Rows and columns of a grid that are enough for a field as smooth as the calibration's share.

    known : (row, col) — points with a value; a narrow specimen keeps all, because thinning would separate neighbours
    """
    stride = min(int(np.sqrt(known.sum() / _MIN_POINTS)), min(known.shape) // _MIN_POINTS_ACROSS)
    part = slice(max(stride, 1) // 2, None, max(stride, 1))
    return part, part


def nearest_on_grid(field: Array, shape: tuple[int, ...], stride: int) -> Array:
    """A field on every ``stride``-th row and column, on the whole grid: at each point the nearest known value."""
    known = np.isfinite(field)
    if not known.any():
        return np.full(shape, np.nan)
    label = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )[1]
    values = np.full(int(label.max()) + 1, np.nan)
    values[label[known]] = field[known]
    whole = values[label].repeat(stride, axis=0).repeat(stride, axis=1)
    beyond = [(0, max(0, full - size)) for full, size in zip(shape, whole.shape, strict=True)]
    return np.asarray(np.pad(whole, beyond, mode="edge")[: shape[0], : shape[1]])


def _slope(field: Array, axis: int) -> Array:
    """Slope of a field along an axis of the grid: mean of the differences to both neighbours, or that to one."""
    gap = np.full_like(np.take(field, [0], axis=axis), np.nan)
    steps = np.diff(field, axis=axis)
    before, after = np.concatenate([gap, steps], axis=axis), np.concatenate([steps, gap], axis=axis)
    single = np.where(np.isnan(before), after, before)
    return np.asarray(np.where(np.isnan(before + after), single, 0.5 * (before + after)))
