"""The exact values of all quantities at points of the first left photograph."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from tests.scenes_in_space.cameras import LEFT, SIZE, project
from tests.scenes_in_space.rendering import material_at
from tests.scenes_in_space.specimen import Scene

__all__ = [
    "Material",
    "crack_distance",
    "gauge_strain",
    "material_of",
    "places",
    "rim_distance",
    "ring_in_photograph",
    "truth",
]

_STEP_MM = 1e-3
_SUBPIXEL_BITS = 4


class Material(NamedTuple):
    """Material points.

    points : (n, 2) [mm]; NaN where a pixel shows no speckled part
    part : (n,) — the part of each
    """

    points: np.ndarray
    part: np.ndarray


def material_of(scene: Scene, pixels: np.ndarray) -> Material:
    """The material that the first left photograph shows at pixels (n, 2)."""
    points, owner = np.full(pixels.shape, np.nan), np.zeros(len(pixels), dtype=int)
    for number, part in enumerate(scene.parts):
        if part.grey is None:
            found = material_at(LEFT, part, scene.loads[0], pixels)
            held = part.holds(found)
            points[held], owner[held] = found[held], number
    return Material(points, owner)


def places(scene: Scene, material: Material, load: float) -> np.ndarray:
    """Places (n, 3) of material points at a load [mm]."""
    found = np.full((len(material.points), 3), np.nan)
    for number, part in enumerate(scene.parts):
        mine = material.part == number
        found[mine] = part.place(material.points[mine], load)
    return found


def truth(scene: Scene, material: Material, step: int) -> dict[str, np.ndarray]:
    """Displacement [mm] and engineering strain since the first step, each (n,), in the frame of the scene.

    x of the strains is the scene's X projected on the surface at the first step, y is normal to it in the surface.
    """
    first, load = scene.loads[0], scene.loads[step]
    moved = places(scene, material, load) - places(scene, material, first)
    before, after = (_tangents(scene, material, at) for at in (first, load))
    along_x, along_y = (after @ coefficients for coefficients in _directions(before))
    stretch_x, stretch_y = (np.linalg.norm(fibre[..., 0], axis=-1) for fibre in (along_x, along_y))
    cosine = np.sum(along_x * along_y, axis=(-1, -2)) / (stretch_x * stretch_y)
    strains = {"exx": stretch_x - 1.0, "eyy": stretch_y - 1.0, "gxy": np.arcsin(cosine)}
    return {**dict(zip("UVW", moved.T, strict=True)), **strains}


def _tangents(scene: Scene, material: Material, load: float) -> np.ndarray:
    """Derivatives (n, 3, 2) of the places by the material."""
    sides = [
        [places(scene, material._replace(points=material.points + sign * _STEP_MM * axis), load) for sign in (-1, 1)]
        for axis in np.eye(2)
    ]
    return np.stack([(after - before) / (2.0 * _STEP_MM) for before, after in sides], axis=-1)


def _directions(tangents: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The directions x and y of a surface in units of its tangents (n, 3, 2): (n, 2, 1) each."""
    normal = np.cross(tangents[..., 0], tangents[..., 1])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    x = np.array([1.0, 0.0, 0.0]) - normal[:, :1] * normal
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    gram = np.swapaxes(tangents, -1, -2) @ tangents
    return tuple(
        np.linalg.solve(gram, np.swapaxes(tangents, -1, -2) @ axis[..., None]) for axis in (x, np.cross(normal, x))
    )


def ring_in_photograph(scene: Scene, ring: np.ndarray) -> np.ndarray:
    """Pixels (n, 2) of a line of material in the first left photograph, as its first part places it."""
    return project(LEFT, scene.parts[0].place(ring, scene.loads[0]))


def rim_distance(scene: Scene, pixels: np.ndarray) -> np.ndarray:
    """Distances (n,) of pixels (n, 2) to the nearest edge, hole or crack of the region [px]."""
    away = _away(scene, [scene.outline, *scene.holes], list(scene.cracks))
    return _at(cv2.distanceTransform(away, cv2.DIST_L2, cv2.DIST_MASK_PRECISE), pixels)


def crack_distance(scene: Scene, pixels: np.ndarray) -> np.ndarray:
    """Distances (n,) of pixels (n, 2) to the nearest crack [px]: the half side of the square that reaches it."""
    away = _away(scene, [], list(scene.cracks))
    return _at(cv2.distanceTransform(away, cv2.DIST_C, cv2.DIST_MASK_3), pixels)


def _away(scene: Scene, rings: list[np.ndarray], lines: list[np.ndarray]) -> np.ndarray:
    """A photograph, 0 where rings and open lines of material are drawn."""
    drawn = np.full(SIZE[::-1], 255, dtype=np.uint8)
    for line, closed in [*((ring, True) for ring in rings), *((line, False) for line in lines)]:
        fixed = np.rint(ring_in_photograph(scene, line) * 2**_SUBPIXEL_BITS).astype(np.int32)
        cv2.polylines(drawn, [fixed], closed, 0, shift=_SUBPIXEL_BITS)
    return drawn


def _at(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    x, y = np.rint(pixels).astype(int).T
    return np.asarray(image[y, x])


def gauge_strain(scene: Scene, gauge: np.ndarray, step: int) -> float:
    """Engineering strain since the first step of the straight line between two points (2, 2) of the first part."""
    first, last = (np.linalg.norm(np.diff(scene.parts[0].place(gauge, scene.loads[k]), axis=0)) for k in (0, step))
    return float(last / first - 1.0)
