"""Why a point has a value, or has none."""

from __future__ import annotations

from enum import IntEnum

__all__ = ["Status"]


class Status(IntEnum):
    """Reason code kept beside every field as ``uint8``; everything above FILLED has the value NaN."""

    VALID = 0
    """Measured."""
    FILLED = 1
    """Not measured here: taken from the neighbours, and marked."""
    OUTSIDE = 2
    """Not in the region of interest, or outside the photograph."""
    LOW_TEXTURE = 3
    """Too little grey-level variation to match."""
    NO_MATCH = 4
    """Stereo matching found no partner."""
    LEFT_RIGHT = 5
    """Matching left to right and right to left disagree."""
    SPECKLE = 6
    """A small island of disparities unlike those around it."""
    BACKGROUND = 7
    """At a depth that is not the specimen's."""
    UNTRACKED = 8
    """No transform carries this point to this step."""
    TOO_FEW_NEIGHBOURS = 9
    """Too few points around it for a local fit."""
    NOT_CONVERGED = 10
    """Correlation found no place at which the subset fits best."""
    LOW_CORRELATION = 11
    """The subset fits nowhere well enough."""
    EPIPOLAR = 12
    """The places in the two photographs are not of one point in space."""
    HIDDEN = 13
    """The other camera does not see it."""
    CUT_SUBSET = 14
    """Too little of its subset lies in the region."""

    @property
    def label(self) -> str:
        """The reason in plain words."""
        return self.name.lower().replace("_", " ")
