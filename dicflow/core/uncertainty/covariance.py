"""Covariance of measured points, and propagation to quantities computed from them.

A point of the surface at a step and at the reference state, (X', X), has errors from three independent sources: the
noise of the photographs of each of the two, and the noise of the template, which is common to both. A template error e
(in pixels of the template) moves the points by −S' e and −S e, so that

    Cov(X', X) = [[Σ' + S' T S'ᵀ, S' T Sᵀ], [S T S'ᵀ, Σ + S T Sᵀ]].
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.cameras.frames import LEFT_CAMERA, Frame, into_frame

__all__ = [
    "MeasuredPoints",
    "derivative",
    "displacement_covariance",
    "displacement_variances",
    "joint_covariance",
    "points_in_frame",
    "sigma_along",
    "with_errors",
]


_DIFFERENCE_STEP = 1e-6


class MeasuredPoints(NamedTuple):
    """Points of one step, and their uncertainty.

    xyz : (..., 3) [mm]
    step_covariance : (..., 3, 3) — by the noise of the photographs of the step [mm²]
    sensitivity : (..., 3, d) — S, motion of the point per template error, with the sign changed [mm/px]
    """

    xyz: Array
    step_covariance: Array
    sensitivity: Array


def points_in_frame(points: MeasuredPoints, frame: Frame) -> MeasuredPoints:
    """The same points in another frame."""
    if frame is LEFT_CAMERA:
        return points
    turn = frame.rotation
    return MeasuredPoints(
        into_frame(points.xyz, frame), turn @ points.step_covariance @ turn.T, turn @ points.sensitivity
    )


def with_errors(points: MeasuredPoints, count: int) -> MeasuredPoints:
    """The points with sensitivities (..., 3, count); further errors of the template do not move them."""
    missing = count - points.sensitivity.shape[-1]
    pad = [(0, 0)] * (points.sensitivity.ndim - 1) + [(0, max(missing, 0))]
    return points._replace(sensitivity=np.pad(points.sensitivity, pad))


def joint_covariance(deformed: MeasuredPoints, reference: MeasuredPoints, template: Array) -> Array:
    """Joint covariance of a point at a step and at the reference state.

    template : (..., d, d) — T, covariance of the template's errors [px²]
    Returns (..., 6, 6), the point at the step first [mm²].
    """
    both = np.concatenate([deformed.sensitivity, reference.sensitivity], axis=-2)
    joint = both @ template @ np.swapaxes(both, -1, -2)
    joint[..., :3, :3] += deformed.step_covariance
    joint[..., 3:, 3:] += reference.step_covariance
    return np.asarray(joint)


def displacement_covariance(joint: Array) -> Array:
    """Covariance (..., 3, 3) of the displacement X' − X from the joint one (..., 6, 6)."""
    across = joint[..., :3, 3:]
    return np.asarray(joint[..., :3, :3] + joint[..., 3:, 3:] - across - np.swapaxes(across, -1, -2))


def displacement_variances(joint: Array) -> Array:
    """Variances (..., 3) of the displacement [mm²], the diagonal of :func:`displacement_covariance`."""
    after, before = np.arange(3), np.arange(3, 6)
    return np.asarray(joint[..., after, after] + joint[..., before, before] - 2.0 * joint[..., after, before])


def sigma_along(covariance: Array, vector: Array) -> Array:
    """Standard deviation (...) of vᵀδ, for δ with covariance (..., d, d) and v (..., d)."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("...i,...ij,...j->...", vector, covariance, vector), 0.0)))


def derivative(function: Callable[[Array], Array], values: Array) -> Array:
    """Derivatives (..., k, d), by central differences, of a function that maps (..., d) to (..., k)."""
    steps = _DIFFERENCE_STEP * np.eye(values.shape[-1])
    slopes = [(function(values + step) - function(values - step)) / (2.0 * _DIFFERENCE_STEP) for step in steps]
    return np.stack(slopes, axis=-1)
