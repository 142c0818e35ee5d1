"""What the maps of a test share: the part of the specimen that they show, and the look of each quantity."""

from __future__ import annotations

from typing import NamedTuple

from dicflow.kinds.maps import Maps
from dicflow.views.colours import Look, look

__all__ = ["MapWindow", "map_look", "map_window", "with_margin"]

_MARGIN = 0.04


class MapWindow(NamedTuple):
    """The part of the specimen that a map shows.

    extent : x_min, y_min, x_max, y_max [unit]
    unit : of lengths: mm, or px for a measurement in one camera
    positions : array of the total that says where each point is drawn
    """

    extent: tuple[float, float, float, float]
    unit: str
    positions: str

    @property
    def aspect(self) -> float:
        """Width over height."""
        x0, y0, x1, y1 = self.extent
        return (x1 - x0) / (y1 - y0)


def map_look(maps: Maps, quantity: str) -> Look:
    """The look of one quantity of a test's maps."""
    chosen = maps.quantities[quantity]
    return look(quantity, chosen.title, chosen.unit, *chosen.range, maps.colour_map)


def map_window(maps: Maps) -> MapWindow:
    """The window that all maps of a test share."""
    return MapWindow(with_margin(maps.extent), maps.unit, maps.positions)


def with_margin(extent: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """x_min, y_min, x_max, y_max moved outwards by a share of the longer side."""
    x0, y0, x1, y1 = extent
    margin = _MARGIN * max(x1 - x0, y1 - y0)
    return x0 - margin, y0 - margin, x1 + margin, y1 + margin
