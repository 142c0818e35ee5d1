"""Which photograph a point has left: what the status "outside" of a total does not say."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

from numpy.typing import NDArray

from dicflow.core.status import Status

__all__ = ["Outside", "status_by_photograph"]

Array = NDArray[Any]


class Outside(IntEnum):
    """Codes that stand for OUTSIDE within a page: whose photograph the subset has left."""

    LEFT = 100
    """Its subset reaches beyond the left photograph of this step."""
    RIGHT = 101
    """Its subset reaches beyond the right photograph of this step."""
    FIRST_RIGHT = 102
    """Its subset reaches beyond the right photograph of the first step, so it can be followed in no later one."""

    @property
    def label(self) -> str:
        """What it says in a list of reasons."""
        return f"outside the {_PHOTOGRAPHS[self]} photograph"

    @property
    def colour(self) -> str:
        """Its colour in the picture of reasons."""
        return _COLOURS[self]


_PHOTOGRAPHS = {Outside.LEFT: "left", Outside.RIGHT: "right", Outside.FIRST_RIGHT: "first right"}
_COLOURS = {Outside.LEFT: "#8c8c8c", Outside.RIGHT: "#c5b0d5", Outside.FIRST_RIGHT: "#c49c94"}


def status_by_photograph(status: Array, inside: Array, left: Array, right: Array | None, first: Array | None) -> Array:
    """The status of a total (row, col), with codes of :class:`Outside` for points that have left a photograph.

    inside : (row, col) bool — points of the region
    left, right, first : (row, col) — status in the left and the right photograph of the step, and in the right one of
        the first step; None for one camera
    """
    found = status.copy()
    unknown = inside & (status == Status.OUTSIDE)
    found[unknown & (left == Status.OUTSIDE)] = Outside.LEFT
    if right is not None and first is not None:
        seen = unknown & (left != Status.OUTSIDE)
        found[seen & (right == Status.OUTSIDE)] = Outside.RIGHT
        found[seen & (first == Status.OUTSIDE)] = Outside.FIRST_RIGHT
    return found
