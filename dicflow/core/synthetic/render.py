"""Photographs of a strip or a board: the pattern integrated over each pixel's square with Gauss–Legendre points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Bytes
from dicflow.core.cameras.camera import Camera
from dicflow.core.synthetic.checkerboard import Checkerboard, board_darkness
from dicflow.core.synthetic.deformation import Deformation
from dicflow.core.synthetic.speckle import Speckles, darkness
from dicflow.core.synthetic.trace import Box, image_of, trace

__all__ = [
    "Extent",
    "GreyLevels",
    "PixelShares",
    "add_noise_and_round",
    "extent_outline",
    "painted",
    "photograph",
    "pixel_shares",
    "render_board",
    "render_strip",
]

Pattern = Callable[[Array], Array]
"""Darkness (...) of material points (..., 2) [mm], 0 … 1."""

Traced = Callable[[Box], tuple[Array, Array]]
"""Material points (row, col, 2) [mm] and their slopes (row, col, 2, 2) [mm/px] at the pixels of a box."""

_ROWS_AT_ONCE = 32


class Extent(NamedTuple):
    """A rectangle of material [mm]."""

    left: float
    right: float
    top: float
    bottom: float


class GreyLevels(NamedTuple):
    """Grey levels of a scene.

    paper, ink : levels of the surface and of the pattern on it
    background : mean level of the background
    unevenness : amplitude of the background's slow waves
    light : relative change of the light from edge to edge of the photograph, along x and along y [-]
    gain : of this camera [-]
    phase : of the background's waves, different for each camera [rad]
    """

    paper: float = 178.0
    ink: float = 42.0
    background: float = 74.0
    unevenness: float = 5.0
    light: tuple[float, float] = (0.10, -0.08)
    gain: float = 1.0
    phase: float = 0.0


class PixelShares(NamedTuple):
    """Shares of each pixel's square that the surface and the ink on it cover, each (...) in 0 … 1."""

    surface: Array
    ink: Array


def render_strip(
    camera: Camera, deformation: Deformation, speckles: Speckles, overhang: float, levels: GreyLevels, order: int = 3
) -> Array:
    """Photograph of a speckled strip without noise.

    deformation : in this camera's frame
    overhang : length of the strip without speckles beyond each end of the speckled region [mm]
    order : Gauss–Legendre points per direction and pixel
    Returns (height, width) grey levels.
    """
    half = deformation.width / 2.0
    extent = Extent(-half, half, -overhang, deformation.length + overhang)
    return photograph(camera, deformation, extent, lambda points: darkness(speckles, points), levels, order)


def render_board(camera: Camera, pose: Deformation, board: Checkerboard, levels: GreyLevels, order: int = 4) -> Array:
    """Photograph of a checkerboard without noise: (height, width) grey levels.

    pose : an undeformed state; its rotation and translation transform the board's frame to this camera's
    """
    margin, square = board.margin, board.square
    extent = Extent(-margin, board.columns * square + margin, -margin, board.rows * square + margin)
    return photograph(camera, pose, extent, lambda points: board_darkness(board, points), levels, order)


def photograph(
    camera: Camera, deformation: Deformation, extent: Extent, pattern: Pattern, levels: GreyLevels, order: int
) -> Array:
    """Photograph of any flat pattern in a deformed state without noise: (height, width) grey levels.

    deformation : in this camera's frame
    extent : of the material
    order : Gauss–Legendre points per direction and pixel
    """
    start = np.array([extent.left + extent.right, extent.top + extent.bottom]) / 2.0

    def traced(box: Box) -> tuple[Array, Array]:
        return trace(camera, deformation, box, start)

    outline = image_of(camera, deformation, extent_outline(extent))
    return painted(camera, outline, traced, extent, pattern, levels, order)


def painted(
    camera: Camera, outline: Array, traced: Traced, extent: Extent, pattern: Pattern, levels: GreyLevels, order: int
) -> Array:
    """Photograph of any surface: the background, over which the surface is rendered a few rows at a time.

    outline : of the extent in the photograph, (n, 2) [px]
    traced : finds the material of pixels
    """
    backdrop, light = _backdrop(camera, levels), _light(camera, levels)
    image = backdrop.copy()
    x0, y0, x1, y1 = _clipped_box(camera, outline)
    for top in range(y0, y1, _ROWS_AT_ONCE):
        bottom = min(top + _ROWS_AT_ONCE, y1)
        points, slopes = traced((x0, top, x1, bottom))
        surface, ink = pixel_shares(points, slopes, extent, pattern, order)
        here = np.s_[top:bottom, x0:x1]
        image[here] = backdrop[here] * (1.0 - surface) + levels.paper * (surface - ink) + levels.ink * ink
    return image * light


def add_noise_and_round(image: Array, noise: float, seed: Sequence[int]) -> Bytes:
    """The image with Gaussian noise of a standard deviation [grey levels], rounded to 8 bits."""
    rng = np.random.default_rng(seed)
    noisy = image + noise * rng.standard_normal(image.shape, dtype=np.float32)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def extent_outline(extent: Extent, count: int = 40) -> Array:
    """The rectangle's closed outline (4 count + 1, 2) [mm], ``count`` points to a side, clockwise in the image."""
    left, right, top, bottom = extent
    corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    along = np.linspace(0.0, 1.0, count, endpoint=False)[:, None]
    sides = [a + along * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    return np.concatenate([*sides, corners[:1]])


def pixel_shares(points: Array, slopes: Array, extent: Extent, pattern: Pattern, order: int) -> PixelShares:
    """Shares of the surface and its ink in pixels, by integration over their squares.

    points : (..., 2) — material at the pixels' centres [mm]; NaN where a pixel shows no material
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
    return PixelShares(surface, ink)


def _gauss_square(order: int) -> tuple[Array, Array]:
    """Gauss–Legendre points (order², 2) in the square [−½, ½]², and their weights, which sum to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    x, y = np.meshgrid(nodes / 2.0, nodes / 2.0)
    return np.stack([x, y], axis=-1).reshape(-1, 2), np.outer(weights, weights).reshape(-1) / 4.0


def _clipped_box(camera: Camera, pixels: Array) -> Box:
    """Box of pixels around an outline with a margin of two, clipped to the photograph."""
    low = np.floor(pixels.min(axis=0)).astype(int) - 2
    high = np.ceil(pixels.max(axis=0)).astype(int) + 3
    (x0, y0), (x1, y1) = np.clip(low, 0, camera.size), np.clip(high, 0, camera.size)
    return int(x0), int(y0), int(x1), int(y1)


def _backdrop(camera: Camera, levels: GreyLevels) -> Array:
    """Grey levels of the background: two slow waves across the photograph."""
    width, height = camera.size
    x, y = np.arange(width) / width, np.arange(height)[:, None] / height
    waves = np.sin(5.0 * x + 3.0 * y + levels.phase) + np.cos(9.0 * y - 4.0 * x + 2.0 * levels.phase)
    return np.asarray(levels.background + 0.5 * levels.unevenness * waves)


def _light(camera: Camera, levels: GreyLevels) -> Array:
    """Relative light at each pixel, a plane over the photograph."""
    width, height = camera.size
    x, y = np.arange(width) / width - 0.5, np.arange(height)[:, None] / height - 0.5
    return np.asarray(levels.gain * (1.0 + levels.light[0] * x + levels.light[1] * y))
