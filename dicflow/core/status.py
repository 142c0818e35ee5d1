"""Status codes of points: measured, filled, or the reason why a value is missing."""

from __future__ import annotations

from enum import IntEnum

__all__ = ["Status"]


class Status(IntEnum):
    """Code kept beside every field as ``uint8``; where it is above FILLED, the value is NaN."""

    VALID = 0
    """Measured."""
    FILLED = 1
    """Not measured; interpolated from the neighbours."""
    OUTSIDE = 2
    """Outside the region of interest or the photograph."""
    LOW_TEXTURE = 3
    """Too little grey-level variation for matching."""
    NO_MATCH = 4
    """Stereo matching did not find a partner in the other photograph."""
    LEFT_RIGHT = 5
    """Matching from left to right and from right to left disagree."""
    SPECKLE = 6
    """A small island of disparities that differ from those around it."""
    BACKGROUND = 7
    """Too far from the specimen's surface in depth."""
    UNTRACKED = 8
    """The point could not be followed to this step."""
    TOO_FEW_NEIGHBOURS = 9
    """Too few valid points around it for a local fit."""
    NOT_CONVERGED = 10
    """The iterations of the correlation did not converge."""
    LOW_CORRELATION = 11
    """The correlation coefficient at the best match is too low."""
    EPIPOLAR = 12
    """The matched points lie too far from each other's epipolar lines."""
    HIDDEN = 13
    """Not visible in the other camera."""
    CUT_SUBSET = 14
    """Too small a part of its subset lies in the region."""
    OVEREXPOSED = 15
    """Too large a part of its subset is clipped to white or black, or hidden, in one of the photographs."""
    MISFIT = 16
    """The grey levels of its subset fit no single motion: something in front of it, lost paint, or a reflection."""
    OUTLIER = 17
    """Its motion does not agree with that of its neighbours."""
    DISCONTINUITY = 18
    """The points on its two sides move apart: a crack, the border of a part, or strain that changes too fast."""
    UNEVEN_LIGHT = 19
    """The light changes across its subset: the edge of a shadow or of a reflection."""
    BLURRED = 20
    """The photograph is too blurred there for the pattern to be found."""

    @property
    def label(self) -> str:
        """The code's name in lower case with spaces."""
        return self.name.lower().replace("_", " ")
