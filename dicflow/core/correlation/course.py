"""Where material points without a value should be, by their last known places and motions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array

__all__ = ["Course", "next_course"]


class Course(NamedTuple):
    """Last known places and motions of points at a step.

    place : (..., 2) — as found, or else extrapolated by the last motion; NaN for points that were never found [px]
    motion : (..., 2) — the last known one from a step to the next [px]
    """

    place: Array
    motion: Array

    @property
    def expected(self) -> Array:
        """Places at the next step if the motion stays the same (..., 2) [px]."""
        return self.place + self.motion


def next_course(course: Course, previous: Array, found: Array) -> Course:
    """The course at the next step.

    previous, found : (..., 2) — places found at the previous step and at this one [px]; NaN where not found

    The motion of a point that was not found at the previous step is 0.

    >>> course = Course(np.array([[5.0, 5.0]]), np.array([[-4.0, 0.0]]))
    >>> next_course(course, np.array([[5.0, 5.0]]), np.array([[np.nan, np.nan]])).expected
    array([[-3.,  5.]])
    """
    known = np.isfinite(found)
    motion = np.where(known, np.nan_to_num(found - previous), course.motion)
    return Course(np.where(known, found, course.expected), motion)
