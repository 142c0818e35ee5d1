"""The rigid-body motion of a cloud of points, and the frame that moves with it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array
from dicflow.core.cameras.camera import rotation_vector
from dicflow.core.cameras.frames import Frame

__all__ = ["RigidMotion", "co_moving_frame", "rigid_motion"]


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
    """The motion that minimises Σ w |X' − moved(X)|² (Kabsch 1976, Acta Cryst. A32:922).

    reference, deformed : (..., 3) — the same points in both states [mm]; those with a NaN in either are left out
    weights : (...) — w, as 1 / σ²; equal if absent

    Raises ValueError where fewer than three points are left or all lie on one line.
    """
    before, after = (np.asarray(points, dtype=np.float64).reshape(-1, 3) for points in (reference, deformed))
    weight = np.ones(len(before)) if weights is None else np.array(weights, dtype=np.float64).ravel()
    known = np.isfinite(before + after).all(axis=1) & (weight > 0.0)
    before, after, weight = before[known], after[known], weight[known]
    if len(before) < 3:
        raise ValueError(f"a rigid-body motion needs three points, found {len(before)}")
    weight /= weight.sum()
    centre, centre_after = weight @ before, weight @ after
    left, singular_values, right = np.linalg.svd((after - centre_after).T @ (weight[:, None] * (before - centre)))
    if singular_values[1] <= 1e-9 * singular_values[0]:
        raise ValueError("a rigid-body motion needs points that do not lie on one line")
    proper = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    return RigidMotion(left @ proper @ right, centre, centre_after - centre)


def co_moving_frame(motion: RigidMotion) -> Frame:
    """The frame that moved with the body: in it, points of a rigid body keep their reference coordinates."""
    back = motion.rotation.T
    return Frame(back, motion.centre + motion.translation - motion.rotation @ motion.centre)
