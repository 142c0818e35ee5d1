"""A polygon with holes."""

from __future__ import annotations

from typing import NamedTuple

from dicflow.core.arrays import Array

__all__ = ["Polygon"]


class Polygon(NamedTuple):
    """One part of a region.

    exterior : (n, 2) float64 — outline [px]
    holes : outlines of its holes, each (m, 2) float64 [px]
    """

    exterior: Array
    holes: tuple[Array, ...] = ()

    @property
    def rings(self) -> tuple[Array, ...]:
        """The exterior and the holes."""
        return self.exterior, *self.holes
