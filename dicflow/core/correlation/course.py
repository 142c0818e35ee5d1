"""Where material points are that a photograph does not show, by their last known places and motions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array

__all__ = ["Course", "carried_on"]


class Course(NamedTuple):
    """Points on their way through a series of photographs.

    place : (..., 2) — at a step: as found, or as the motion has carried them on; NaN for what was never found [px]
    motion : (..., 2) — since the step before, the last one known [px]
    """

    place: Array
    motion: Array

    @property
    def expected(self) -> Array:
        """Where the next photograph will have the points, if they move on alike (..., 2) [px]."""
        return self.place + self.motion


def carried_on(course: Course, before: Array, found: Array) -> Course:
    """The course at the next step.

    before, found : (..., 2) — places found at the step before and at this one [px]; NaN where there are none

    A point that has just been found again has no motion yet.

    >>> course = Course(np.array([[5.0, 5.0]]), np.array([[-4.0, 0.0]]))
    >>> carried_on(course, np.array([[5.0, 5.0]]), np.array([[np.nan, np.nan]])).expected
    array([[-3.,  5.]])
    """
    known = np.isfinite(found)
    motion = np.where(known, np.nan_to_num(found - before), course.motion)
    return Course(np.where(known, found, course.expected), motion)
