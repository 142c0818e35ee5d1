"""Photographs of scenes: at nine places in every pixel the material that its ray meets, and the speckles there.

The material of a ray is found by Newton's method at the nodes of a table, and by cubic interpolation in between, whose
error is below 1e-3 px.
"""

from __future__ import annotations

import itertools

import cv2
import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from tests.scenes_in_space.cameras import LEFT, MM_PX, RIGHT, SIZE, View, project
from tests.scenes_in_space.pattern import light_of_speckles
from tests.scenes_in_space.specimen import Part, Scene

__all__ = ["clean", "exposed", "interpolated", "material_at", "material_table", "seen_box", "with_noise"]

PAPER, INK, BACKGROUND = 190.0, 40.0, 65.0
_NODE_PX, _BEFORE = 2, 2
"""Distance of the nodes of a table, and how many lie before the photograph."""
_MARGIN_PX = 16.0
"""How far beyond a part's edge its surface is continued."""
_SAMPLES = (-1.0 / 3.0, 0.0, 1.0 / 3.0)
_STEP_MM, _TOLERANCE_PX, _ROUNDS = 1e-4, 1e-7, 15
_SEED_MM = 0.5
"""Distance of the material points from which the nearest one starts a search."""


def exposed(scene: Scene, step: int, side: int) -> np.ndarray:
    """Grey levels (row, col) of the photograph of a step by a camera, 0 or 1, without noise."""
    return scene.look(clean((LEFT, RIGHT)[side], scene, scene.loads[step]), step, side)


def with_noise(grey: np.ndarray, scene: Scene, draw: tuple[int, int, int] | None) -> np.ndarray:
    """A photograph (row, col) uint8. draw : number, step and camera of a draw of the noise; None without noise"""
    if draw is not None:
        constant, growing = scene.noise
        random = np.random.default_rng(draw).standard_normal(grey.shape)
        grey = grey + np.sqrt(constant + growing * np.maximum(grey, 0.0)) * random
    return np.rint(grey).clip(0, 255).astype(np.uint8)


def clean(view: View, scene: Scene, load: float) -> np.ndarray:
    """Grey levels (row, col) of a view without noise."""
    tables = [material_table(view, part, load) for part in scene.parts]
    total = np.zeros(SIZE[::-1])
    for dy, dx in itertools.product(_SAMPLES, _SAMPLES):
        total += _seen(scene, tables, dx, dy)
    return total / len(_SAMPLES) ** 2


def _seen(scene: Scene, tables: list[np.ndarray], dx: float, dy: float) -> np.ndarray:
    """Grey levels (row, col) at one place in every pixel: those of the nearest part."""
    grey, depth = np.full(SIZE[::-1], BACKGROUND), np.full(SIZE[::-1], np.inf)
    for part, table in zip(scene.parts, tables, strict=True):
        x0, x1, y0, y1 = box = seen_box(table)
        here = np.s_[y0:y1, x0:x1]
        found = interpolated(table, dx, dy, box)
        front = part.holds(found[..., :2]) & (found[..., 2] < depth[here])
        depth[here][front] = found[front, 2]
        grey[here][front] = _grey(scene, part, found[front, :2])
    return grey


def _grey(scene: Scene, part: Part, material: np.ndarray) -> np.ndarray | float:
    """Grey levels (n,) of material points (n, 2)."""
    return INK + (PAPER - INK) * light_of_speckles(material, scene.speckle) if part.grey is None else part.grey


def seen_box(table: np.ndarray) -> tuple[int, int, int, int]:
    """Pixels x0 ≤ x < x1, y0 ≤ y < y1 of the photograph in which a part is seen."""
    x, y, width, height = cv2.boundingRect(np.isfinite(table[..., 0]).astype(np.uint8))
    low = _NODE_PX * (np.array([x, y]) - _BEFORE)
    (x0, y0), (x1, y1) = np.clip([low, low + _NODE_PX * np.array([width, height])], 0, SIZE).tolist()
    return x0, x1, y0, y1


def material_at(view: View, part: Part, load: float, pixels: np.ndarray) -> np.ndarray:
    """Material points (n, 2) of a part at pixels (n, 2); NaN where its surface is far away, or a ray misses it."""
    x0, y0, x1, y1 = part.bounds
    x, y = (np.linspace(a, b, 2 + int((b - a) / _SEED_MM)) for a, b in ((x0, x1), (y0, y1)))
    seeds = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    images = project(view, part.place(seeds, load))
    reach = _MARGIN_PX + 2.0 * _SEED_MM / MM_PX
    away, nearest = cKDTree(images).query(pixels, distance_upper_bound=reach)
    near = np.isfinite(away)
    found = np.full(pixels.shape, np.nan)
    found[near] = _solved(view, part, load, pixels[near], seeds[nearest[near]])
    return found


def _solved(view: View, part: Part, load: float, pixels: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Material points (n, 2) at pixels (n, 2) by Newton's method; NaN where it does not converge."""

    def image(material: np.ndarray) -> np.ndarray:
        return project(view, part.place(material, load))

    material = start.copy()
    for _ in range(_ROUNDS):
        left = pixels - (here := image(material))
        if not np.nanmax(np.abs(left), initial=0.0) > _TOLERANCE_PX:
            break
        (a, c), (b, d) = ((image(material + _STEP_MM * axis) - here).T / _STEP_MM for axis in np.eye(2))
        du, dv = left.T
        with np.errstate(divide="ignore", invalid="ignore"):
            material += np.stack([d * du - b * dv, a * dv - c * du], axis=-1) / (a * d - b * c)[:, None]
    material[~(np.abs(pixels - image(material)).max(axis=-1) < 10.0 * _TOLERANCE_PX)] = np.nan
    return material


def material_table(view: View, part: Part, load: float) -> np.ndarray:
    """Material and depth (row, col, 3) at the nodes; NaN where a part is not seen."""
    x, y = (_NODE_PX * np.arange(-_BEFORE, side // _NODE_PX + 3, dtype=float) for side in SIZE)
    pixels = np.stack(np.meshgrid(x, y), axis=-1)
    material = material_at(view, part, load, pixels.reshape(-1, 2))
    depth = (part.place(material, load) @ view.rotation.T + view.translation)[:, 2:]
    return np.concatenate([material, depth], axis=-1).reshape(*pixels.shape[:2], 3)


@njit(cache=True, nogil=True)
def _cubic(t):  # type: ignore[no-untyped-def]
    """Weights of four equidistant nodes at −1, 0, 1 and 2."""
    return (
        -t * (t - 1.0) * (t - 2.0) / 6.0,
        (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
        -(t + 1.0) * t * (t - 2.0) / 2.0,
        (t + 1.0) * t * (t - 1.0) / 6.0,
    )


@njit(cache=True, nogil=True)
def interpolated(table, dx, dy, box):  # type: ignore[no-untyped-def]
    """Values (row, col, 3) of a table at a place in every pixel of a box x0 ≤ x < x1, y0 ≤ y < y1."""
    x0, x1, y0, y1 = box
    out = np.empty((y1 - y0, x1 - x0, 3))
    for v in range(y1 - y0):
        y = (v + y0 + dy) / _NODE_PX + _BEFORE
        i = int(np.floor(y))
        by = _cubic(y - i)
        for u in range(x1 - x0):
            x = (u + x0 + dx) / _NODE_PX + _BEFORE
            j = int(np.floor(x))
            bx = _cubic(x - j)
            for c in range(3):
                value = 0.0
                for m in range(4):
                    row = table[i - 1 + m]
                    value += by[m] * (
                        bx[0] * row[j - 1, c] + bx[1] * row[j, c] + bx[2] * row[j + 1, c] + bx[3] * row[j + 2, c]
                    )
                out[v, u, c] = value
    return out
