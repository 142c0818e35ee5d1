"""What a scene is: parts of a specimen that move on their own, and what changes the photographs beside the motion.

The frame of a scene has X to the right, Y down and Z away from the cameras; its origin is the middle of both
photographs. A material point is a pair of numbers [mm]. A load is any number that says how far a test has come.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

__all__ = ["Look", "Part", "Place", "Scene", "bounds", "circle", "everywhere", "rectangle", "still", "turned"]

Place = Callable[[np.ndarray, float], np.ndarray]
"""Places (..., 3) [mm] of material points (..., 2) [mm] at a load: smooth, also a little beyond the part."""
Look = Callable[[np.ndarray, int, int], np.ndarray]
"""Grey levels (row, col) of a step's photograph, by the camera 0 or 1, as changed by light or lens."""


def everywhere(material: np.ndarray) -> np.ndarray:
    """A part that fills its bounds."""
    return np.ones(material.shape[:-1], dtype=bool)


def still(grey: np.ndarray, step: int, side: int) -> np.ndarray:
    """The same light and lens at every step."""
    return grey


class Part(NamedTuple):
    """What moves as one.

    place : where its material is
    bounds : x0, y0, x1, y1 of its material [mm]
    covers : which material points (..., 2) within the bounds belong to it
    grey : of a part without speckles; None with speckles
    """

    place: Place
    bounds: tuple[float, float, float, float]
    covers: Callable[[np.ndarray], np.ndarray] = everywhere
    grey: float | None = None

    def holds(self, material: np.ndarray) -> np.ndarray:
        """Which material points (..., 2) belong to the part; NaN does not."""
        x, y = material[..., 0], material[..., 1]
        x0, y0, x1, y1 = self.bounds
        return (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1) & self.covers(material)


class Scene(NamedTuple):
    """A specimen, and how it is loaded and photographed.

    loads : of all steps, the first of which is the reference
    parts : of the specimen, and of what stands in front of it
    outline, holes : rings (n, 2) of the region to measure [mm of material]
    cracks : lines (n, 2) inside it where parts come apart [mm of material]
    gauges : extensometers by name, two points (2, 2) of the first part [mm of material]
    reported : the steps of which figures are printed; all later ones if empty
    speckle : mean diameter of a speckle [mm of material]
    look : light and lens
    noise : a and b of the variance a + b g of a grey level g
    jpeg : quality of the files; None for files without loss
    """

    loads: tuple[float, ...]
    parts: tuple[Part, ...]
    outline: np.ndarray
    holes: tuple[np.ndarray, ...] = ()
    cracks: tuple[np.ndarray, ...] = ()
    gauges: Mapping[str, np.ndarray] = MappingProxyType({})
    reported: tuple[int, ...] = ()
    speckle: float = 0.5
    look: Look = still
    noise: tuple[float, float] = (4.0, 0.0)
    jpeg: int | None = None

    @property
    def steps(self) -> tuple[int, ...]:
        """Numbers of the steps of which figures are printed."""
        return self.reported or tuple(range(1, len(self.loads)))


def rectangle(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    """Ring (n, 2) of a rectangle, with a corner every millimetre or so."""
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float)
    sides = [
        np.linspace(a, b, max(2, int(np.abs(b - a).max())), endpoint=False)
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)
    ]
    return np.concatenate(sides)


def circle(radius: float, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    """Ring (n, 2) of a circle."""
    angle = np.linspace(0.0, 2.0 * np.pi, 120, endpoint=False)
    return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=-1)


def bounds(half_width: float, half_height: float) -> tuple[float, float, float, float]:
    """Bounds of a part around the origin."""
    return -half_width, -half_height, half_width, half_height


def turned(points: np.ndarray, vector: tuple[float, float, float]) -> np.ndarray:
    """Points (..., 3) turned about the origin by a vector's length [rad] around its direction (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return points
    axis = np.array(vector) / angle
    along = (points @ axis)[..., None] * axis
    return along + np.cos(angle) * (points - along) + np.sin(angle) * np.cross(axis, points)
