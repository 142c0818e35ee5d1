"""Covariance of measured points, and what follows from it for all that is computed of them.

A point of the surface at a step and at the reference, (X', X), has errors of three sources that are independent of one
another: the noise of the photographs of each step, and the noise of the template, which is common to both. A template
error e (in reference pixels) moves the points by −S' e and −S e, so that

    Cov(X', X) = [[Σ' + S' T S'ᵀ, S' T Sᵀ], [S T S'ᵀ, Σ + S T Sᵀ]].
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.cameras.frames import Frame, into_frame

__all__ = [
    "MeasuredPoints",
    "derivative",
    "displacement_covariance",
    "joint_covariance",
    "points_in_frame",
    "sigma_along",
]


_DIFFERENCE = 1e-6


class MeasuredPoints(NamedTuple):
    """Points of one step, and what is uncertain about them.

    xyz : (..., 3) [mm]
    own : (..., 3, 3) — covariance from the photographs of the step [mm²]
    sensitivity : (..., 3, 2) — S, by how much the point moves per template error [mm/px]
    """

    xyz: Array
    own: Array
    sensitivity: Array


def points_in_frame(points: MeasuredPoints, frame: Frame) -> MeasuredPoints:
    """The same points, given in another frame."""
    turn = frame.rotation
    return MeasuredPoints(into_frame(points.xyz, frame), turn @ points.own @ turn.T, turn @ points.sensitivity)


def joint_covariance(deformed: MeasuredPoints, reference: MeasuredPoints, template: Array) -> Array:
    """Covariance of a point at a step and at the reference.

    template : (..., 2, 2) — T, covariance of the template's error [px²]
    Returns (..., 6, 6), the point at the step first [mm²].
    """
    both = np.concatenate([deformed.sensitivity, reference.sensitivity], axis=-2)
    joint = both @ template @ np.swapaxes(both, -1, -2)
    joint[..., :3, :3] += deformed.own
    joint[..., 3:, 3:] += reference.own
    return np.asarray(joint)


def displacement_covariance(joint: Array) -> Array:
    """Covariance (..., 3, 3) of X' − X from the joint one."""
    across = joint[..., :3, 3:]
    return np.asarray(joint[..., :3, :3] + joint[..., 3:, 3:] - across - np.swapaxes(across, -1, -2))


def sigma_along(covariance: Array, vector: Array) -> Array:
    """Standard deviation (...) of vᵀδ, for δ with covariance (..., d, d) and v (..., d)."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("...i,...ij,...j->...", vector, covariance, vector), 0.0)))


def derivative(function: Callable[[Array], Array], values: Array) -> Array:
    """Derivative (..., k, d) of a function of (..., d) that gives (..., k), by central differences."""
    steps = _DIFFERENCE * np.eye(values.shape[-1])
    slopes = [(function(values + step) - function(values - step)) / (2.0 * _DIFFERENCE) for step in steps]
    return np.stack(slopes, axis=-1)
