"""Photographs of a strip or a board: what each pixel's square shows, integrated with Gauss–Legendre points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dicflow.core.arrays import Array
from dicflow.core.cameras.camera import Camera
from dicflow.core.synthetic.checkerboard import Checkerboard, board_darkness
from dicflow.core.synthetic.deformation import Deformation
from dicflow.core.synthetic.speckle import Speckles, darkness
from dicflow.core.synthetic.trace import Box, image_of, trace

__all__ = ["Extent", "Look", "Shares", "expose", "outline", "photograph", "render_board", "render_strip", "shares"]

Pattern = Callable[[Array], Array]
"""How dark material points (..., 2) [mm] are: (...) in 0 … 1."""

_ROWS_AT_ONCE = 32


class Extent(NamedTuple):
    """A rectangle of material [mm]."""

    left: float
    right: float
    top: float
    bottom: float


class Look(NamedTuple):
    """Grey levels of a scene.

    paper, ink : of the bare surface and of the pattern on it
    background : mean level behind it
    unevenness : amplitude of the background's slow waves
    light : relative change of the light from edge to edge of the photograph, along x and along y [-]
    gain : of this camera [-]
    phase : of the background's waves, another for each camera [rad]
    """

    paper: float = 178.0
    ink: float = 42.0
    background: float = 74.0
    unevenness: float = 5.0
    light: tuple[float, float] = (0.10, -0.08)
    gain: float = 1.0
    phase: float = 0.0


class Shares(NamedTuple):
    """What parts of each pixel's square show the surface and the ink on it, each (...) in 0 … 1."""

    surface: Array
    ink: Array


def render_strip(
    camera: Camera, deformation: Deformation, speckles: Speckles, overhang: float, look: Look, order: int = 3
) -> Array:
    """Photograph of a speckled strip before noise.

    deformation : in this camera's frame
    overhang : length of bare strip beyond each end of the speckled region [mm]
    order : Gauss–Legendre points per direction and pixel
    Returns (height, width) grey levels.
    """
    half = deformation.width / 2.0
    extent = Extent(-half, half, -overhang, deformation.length + overhang)
    return photograph(camera, deformation, extent, lambda points: darkness(speckles, points), look, order)


def render_board(camera: Camera, pose: Deformation, board: Checkerboard, look: Look, order: int = 4) -> Array:
    """Photograph of a checkerboard before noise: (height, width) grey levels.

    pose : a strip at rest whose rotation and translation carry the board into this camera's frame
    """
    margin, square = board.margin, board.square
    extent = Extent(-margin, board.columns * square + margin, -margin, board.rows * square + margin)
    return photograph(camera, pose, extent, lambda points: board_darkness(board, points), look, order)


def photograph(
    camera: Camera, deformation: Deformation, extent: Extent, pattern: Pattern, look: Look, order: int
) -> Array:
    """Photograph of any flat pattern in a deformed state before noise: (height, width) grey levels.

    The background, and over it a few rows at a time of the surface.

    deformation : in this camera's frame
    extent : the part of the plane that is there
    order : Gauss–Legendre points per direction and pixel
    """
    backdrop, light = _backdrop(camera, look), _light(camera, look)
    image = backdrop.copy()
    x0, y0, x1, y1 = _box(camera, image_of(camera, deformation, outline(extent)))
    start = np.array([extent.left + extent.right, extent.top + extent.bottom]) / 2.0
    for top in range(y0, y1, _ROWS_AT_ONCE):
        bottom = min(top + _ROWS_AT_ONCE, y1)
        points, slopes = trace(camera, deformation, (x0, top, x1, bottom), start)
        surface, ink = shares(points, slopes, extent, pattern, order)
        here = np.s_[top:bottom, x0:x1]
        image[here] = backdrop[here] * (1.0 - surface) + look.paper * (surface - ink) + look.ink * ink
    return image * light


def expose(image: Array, noise: float, seed: Sequence[int]) -> NDArray[np.uint8]:
    """Add Gaussian noise of a standard deviation in grey levels, and round to 8 bits."""
    rng = np.random.default_rng(seed)
    noisy = image + noise * rng.standard_normal(image.shape, dtype=np.float32)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def outline(extent: Extent, count: int = 40) -> Array:
    """The rectangle's closed outline (4 count + 1, 2) [mm], ``count`` points to a side, clockwise in the image."""
    left, right, top, bottom = extent
    corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    along = np.linspace(0.0, 1.0, count, endpoint=False)[:, None]
    sides = [a + along * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    return np.concatenate([*sides, corners[:1]])


def shares(points: Array, slopes: Array, extent: Extent, pattern: Pattern, order: int) -> Shares:
    """Integrate the surface and its ink over pixels.

    points : (..., 2) — material at the pixels' centres [mm]; NaN where a pixel sees none
    slopes : (..., 2, 2) — ∂material/∂pixel [mm/px]
    order : Gauss–Legendre points per direction
    """
    nodes, weights = _gauss_square(order)
    surface, ink = np.zeros(points.shape[:-1]), np.zeros(points.shape[:-1])
    for (u, v), weight in zip(nodes, weights, strict=True):
        x, y = np.moveaxis(sample := points + u * slopes[..., 0] + v * slopes[..., 1], -1, 0)
        inside = (x >= extent.left) & (x <= extent.right) & (y >= extent.top) & (y <= extent.bottom)
        surface += weight * inside
        ink += weight * inside * pattern(sample)
    return Shares(surface, ink)


def _gauss_square(order: int) -> tuple[Array, Array]:
    """Gauss–Legendre points (order², 2) in the square [−½, ½]², and their weights, which sum to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    x, y = np.meshgrid(nodes / 2.0, nodes / 2.0)
    return np.stack([x, y], axis=-1).reshape(-1, 2), np.outer(weights, weights).reshape(-1) / 4.0


def _box(camera: Camera, pixels: Array) -> Box:
    """The photograph's pixels around an outline, with two to spare."""
    low = np.floor(pixels.min(axis=0)).astype(int) - 2
    high = np.ceil(pixels.max(axis=0)).astype(int) + 3
    (x0, y0), (x1, y1) = np.clip(low, 0, camera.size), np.clip(high, 0, camera.size)
    return int(x0), int(y0), int(x1), int(y1)


def _backdrop(camera: Camera, look: Look) -> Array:
    """A plain wall, a little uneven: two slow waves across the photograph."""
    width, height = camera.size
    x, y = np.arange(width) / width, np.arange(height)[:, None] / height
    waves = np.sin(5.0 * x + 3.0 * y + look.phase) + np.cos(9.0 * y - 4.0 * x + 2.0 * look.phase)
    return np.asarray(look.background + 0.5 * look.unevenness * waves)


def _light(camera: Camera, look: Look) -> Array:
    """Relative light at each pixel, a plane over the photograph."""
    width, height = camera.size
    x, y = np.arange(width) / width - 0.5, np.arange(height)[:, None] / height - 0.5
    return np.asarray(look.gain * (1.0 + look.light[0] * x + look.light[1] * y))
