"""The rigid-body motion of a cloud of points, and the frame that moves along."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array
from dicflow.core.cameras.camera import rotation_vector
from dicflow.core.cameras.frames import Frame

__all__ = ["RigidMotion", "rigid_motion", "undoing"]


class RigidMotion(NamedTuple):
    """X' = rotation @ (X − centre) + centre + translation.

    rotation : (3, 3)
    centre : (3,) — weighted mean of the points at the reference [mm]
    translation : (3,) — of the centre [mm]
    """

    rotation: Array
    centre: Array
    translation: Array

    @property
    def rotation_deg(self) -> Array:
        """Axis (3,) of the rotation, its length the angle [deg]."""
        return np.asarray(np.degrees(rotation_vector(self.rotation)))


def rigid_motion(reference: ArrayLike, deformed: ArrayLike, weights: ArrayLike | None = None) -> RigidMotion:
    """The motion that leaves the least Σ w |X' − moved(X)|² (Kabsch 1976, Acta Cryst. A32:922).

    reference, deformed : (..., 3) — the same points in both states [mm]; those with a NaN in either do not count
    weights : (...) — w, as 1 / σ²; equal if absent

    Raises ValueError where fewer than three points count or all lie on one line.
    """
    before, after = (np.asarray(points, dtype=np.float64).reshape(-1, 3) for points in (reference, deformed))
    weight = np.ones(len(before)) if weights is None else np.array(weights, dtype=np.float64).ravel()
    known = np.isfinite(before + after).all(axis=1) & (weight > 0.0)
    before, after, weight = before[known], after[known], weight[known]
    if len(before) < 3:
        raise ValueError(f"a rigid-body motion needs three points, found {len(before)}")
    weight /= weight.sum()
    centre, centre_after = weight @ before, weight @ after
    left, strengths, right = np.linalg.svd((after - centre_after).T @ (weight[:, None] * (before - centre)))
    if strengths[1] <= 1e-9 * strengths[0]:
        raise ValueError("a rigid-body motion needs points that do not lie on one line")
    handed = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    return RigidMotion(left @ handed @ right, centre, centre_after - centre)


def undoing(motion: RigidMotion) -> Frame:
    """The frame that moved along: in it, points that only moved are where they were at the reference."""
    back = motion.rotation.T
    return Frame(back, motion.centre + motion.translation - motion.rotation @ motion.centre)
