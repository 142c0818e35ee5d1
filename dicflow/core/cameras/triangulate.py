"""Points in space from their raw pixels in both photographs, by maximum likelihood.

Two rays with errors do not intersect. The point of maximum likelihood has the least sum of squared reprojection errors
in both photographs, weighted by the covariances of the pixels (Hartley and Sturm, Computer Vision and Image
Understanding 68, 1997). Gauss–Newton steps start at the midpoint between the rays and include the distortion, so the
errors are those of raw pixels. At the solution the derivatives of the point with respect to the pixels are

    ∂X/∂e = (Jᵀ W J)⁻¹ Jᵀ W,   J = ∂(pixels)/∂X,   W the inverse covariance of the pixels,

to first order in the reprojection error. They propagate the pixels' covariance to the point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array, Mask
from dicflow.core.cameras.camera import Camera, Rig, distortion_slopes, homogeneous, project, to_right, undistort
from dicflow.core.tensors import on_grid

__all__ = ["Triangulated", "point_covariance", "projection_slopes", "ray_midpoints", "triangulate"]


_GAUSS_NEWTON_STEPS = 4
_SETTLED = 1e-8
"""Last step over the distance from the camera. Each is less than a hundredth of the one before."""


class Triangulated(NamedTuple):
    """Points in the left camera's frame; NaN where a pixel is NaN.

    xyz : (..., 3) [mm]
    reprojection : (...) — reprojection error, root mean square over both photographs [px]
    by_left, by_right : (..., 3, 2) — ∂xyz/∂(x, y) of the left and of the right pixel [mm/px]
    """

    xyz: Array
    reprojection: Array
    by_left: Array
    by_right: Array


def triangulate(
    rig: Rig,
    left: ArrayLike,
    right: ArrayLike,
    covariance_left: ArrayLike | None = None,
    covariance_right: ArrayLike | None = None,
) -> Triangulated:
    """Points of maximum likelihood from matched pixels.

    left, right : (..., 2) — raw pixels
    covariance_left, covariance_right : (..., 3) — xx, xy, yy of the pixels' errors, up to a common factor; where
        absent or not of full rank, all errors are taken as independent and equal
    """
    pixels = np.concatenate([np.asarray(left, dtype=float), np.asarray(right, dtype=float)], axis=-1)
    known = np.isfinite(pixels).all(axis=-1)
    measured = pixels[known]
    weight = _weights(known, covariance_left, covariance_right)
    points = ray_midpoints(rig, measured[:, :2], measured[:, 2:])
    for _ in range(_GAUSS_NEWTON_STEPS):
        gain = _gain(rig, points, weight)
        step = np.einsum("nij,nj->ni", gain, measured - _project(rig, points))
        points = points + step
        if not (np.abs(step) > _SETTLED * np.abs(points[:, 2:])).any():
            break
    residual = measured - _project(rig, points)
    results = points, np.sqrt(0.5 * np.sum(residual**2, axis=-1)), gain[..., :2], gain[..., 2:]
    return Triangulated._make(on_grid(part, known) for part in results)


def point_covariance(by_pixel: Array, covariance: ArrayLike) -> Array:
    """Contribution of one photograph to the covariance of points: J Σ Jᵀ.

    by_pixel : (..., 3, 2) — of :class:`Triangulated` [mm/px]
    covariance : (..., 3) — xx, xy, yy of the pixels [px²]
    Returns (..., 3, 3) [mm²].
    """
    return np.asarray(by_pixel @ _covariance_matrices(covariance) @ np.swapaxes(by_pixel, -1, -2))


def ray_midpoints(rig: Rig, left: ArrayLike, right: ArrayLike) -> Array:
    """Midpoints (..., 3) of the shortest lines between the rays of raw pixels (..., 2) [mm]; NaN for parallel rays."""
    ray_left = homogeneous(undistort(rig.left, left))
    ray_right = homogeneous(undistort(rig.right, right)) @ rig.rotation
    centre = -rig.rotation.T @ rig.translation
    ll, rr = np.sum(ray_left**2, axis=-1), np.sum(ray_right**2, axis=-1)
    lr = np.sum(ray_left * ray_right, axis=-1)
    lc, rc = ray_left @ centre, ray_right @ centre
    determinant = ll * rr - lr**2
    determinant = np.where(determinant > 0.0, determinant, np.nan)
    along_left, along_right = (rr * lc - lr * rc) / determinant, (lr * lc - ll * rc) / determinant
    return np.asarray(0.5 * (along_left[..., None] * ray_left + centre + along_right[..., None] * ray_right))


def projection_slopes(camera: Camera, points: Array) -> Array:
    """∂(pixel)/∂(point) (..., 2, 3) of points (..., 3) in this camera's frame [px/mm]."""
    x, y, z = np.moveaxis(points, -1, 0)
    x, y = x / z, y / z
    xx, xy, yy = distortion_slopes(x, y, camera.distortion)
    zero, one = np.zeros_like(z), 1.0 / z
    direction = _stack_matrix(((one, zero, -x / z), (zero, one, -y / z)))
    return np.asarray(camera.matrix[:2, :2] @ _stack_matrix(((xx, xy), (xy, yy))) @ direction)


def _project(rig: Rig, points: Array) -> Array:
    """Pixels (n, 4) of points (n, 3) in both photographs, left first."""
    return np.concatenate([project(rig.left, points), project(rig.right, to_right(rig, points))], axis=-1)


def _gain(rig: Rig, points: Array, weight: Array | None) -> Array:
    """(Jᵀ W J)⁻¹ Jᵀ W (n, 3, 4)."""
    right = projection_slopes(rig.right, to_right(rig, points)) @ rig.rotation
    slopes = np.concatenate([projection_slopes(rig.left, points), right], axis=-2)
    weighted = np.swapaxes(slopes if weight is None else weight @ slopes, -1, -2)
    return np.asarray(np.linalg.solve(weighted @ slopes, weighted))


def _weights(known: Mask, left: ArrayLike | None, right: ArrayLike | None) -> Array | None:
    """Inverse covariances (n, 4, 4) of the known points' pixels, scaled to trace 1; None without covariances."""
    if left is None or right is None:
        return None
    weight = np.broadcast_to(np.eye(4), (int(known.sum()), 4, 4)).copy()
    inverses, usable = zip(*(_inverse(np.asarray(part, dtype=float)[known]) for part in (left, right)), strict=True)
    both = usable[0] & usable[1]
    weight[both, :2, :2], weight[both, 2:, 2:] = inverses[0][both], inverses[1][both]
    weight /= np.trace(weight, axis1=-2, axis2=-1)[:, None, None]
    return weight


def _inverse(covariance: Array) -> tuple[Array, Mask]:
    """Inverses (n, 2, 2) of covariances (n, 3), and which are valid (n,)."""
    xx, xy, yy = covariance.T
    determinant = xx * yy - xy * xy
    usable = (determinant > 0.0) & (xx > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return _stack_matrix(((yy, -xy), (-xy, xx))) / determinant[:, None, None], usable


def _covariance_matrices(covariance: ArrayLike) -> Array:
    """Matrices (..., 2, 2) of covariances (..., 3)."""
    xx, xy, yy = np.moveaxis(np.asarray(covariance, dtype=float), -1, 0)
    return _stack_matrix(((xx, xy), (xy, yy)))


def _stack_matrix(rows: tuple[tuple[Array, ...], ...]) -> Array:
    """Matrices (..., i, j) from their elements (...), given by rows."""
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
