"""Flat speckle images deformed by any smooth motion of the plane.

A material point at X in the reference image is at x(X) in the deformed one, I(x(X)) = I₀(X). The reference point of
every sample within a pixel is found by Newton's method, so the only error of the images is the integration over pixels.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.synthetic.render import Extent, GreyLevels, Pattern, pixel_shares
from dicflow.core.synthetic.speckle import darkness, scatter_speckles

__all__ = ["Motion", "reference_points", "render_pattern", "speckle_pattern", "star", "star_period", "strain_star"]

Motion = Callable[[Array], tuple[Array, Array]]
"""Maps points (..., 2) of the reference [px] to deformed positions (..., 2) and gradients ∂x/∂X (..., 2, 2)."""

_EVEN_LIGHT = GreyLevels(unevenness=0.0, light=(0.0, 0.0))
_EVERYWHERE = Extent(-np.inf, np.inf, -np.inf, np.inf)
_PERIOD_GROWTH_PX = 140.0
_ROWS_AT_ONCE = 8
_MAX_NEWTON_STEPS = 30
_MAX_LAST_STEP_PX = 1e-4
"""Newton's method stops below this step; the remaining error is about its square [px]."""


def speckle_pattern(
    size: tuple[int, int],
    diameter: tuple[float, float] = (3.0, 7.0),
    edge: float = 1.0,
    coverage: float = 0.45,
    margin: float = 20.0,
    seed: int = 0,
) -> Pattern:
    """The speckle pattern of a reference image: darkness 0 … 1 of points (..., 2) [px].

    size : (width, height) of the image [px]
    diameter : of the dots, least and greatest [px]
    edge : width of the transition from black to white [px]
    coverage : share of the image that is dark
    margin : width of the speckled border around the image [px]
    """
    width, height = size[0] + 2.0 * margin, size[1] + 2.0 * margin
    speckles = scatter_speckles((width, height), diameter, edge, coverage, seed=seed)
    corner = np.array([0.5 * size[0], -margin])
    return lambda points: darkness(speckles, points - corner)


def render_pattern(
    pattern: Pattern,
    size: tuple[int, int],
    motion: Motion | None = None,
    levels: GreyLevels = _EVEN_LIGHT,
    order: int = 3,
) -> Array:
    """Image (height, width) of a pattern before noise, evenly lit.

    size : (width, height) [px]
    motion : None gives the reference image
    order : Gauss–Legendre points per direction and pixel
    """

    def moved(places: Array) -> Array:
        return pattern(places if motion is None else reference_points(motion, places))

    ink = np.empty(size[::-1])
    for top in range(0, size[1], _ROWS_AT_ONCE):
        rows = np.arange(top, min(top + _ROWS_AT_ONCE, size[1]))
        pixels = np.stack(np.meshgrid(np.arange(size[0]), rows), axis=-1).astype(float)
        squares = np.broadcast_to(np.eye(2), (*pixels.shape, 2))
        ink[rows] = pixel_shares(pixels, squares, _EVERYWHERE, moved, order).ink
    return np.asarray(levels.paper + (levels.ink - levels.paper) * ink)


def reference_points(motion: Motion, places: Array) -> Array:
    """Points (..., 2) of the reference that a motion maps to ``places`` (..., 2) [px].

    Raises ValueError where Newton's method does not converge, as it may where a motion folds the plane.
    """
    points = places.copy()
    for _ in range(_MAX_NEWTON_STEPS):
        at, slope = motion(points)
        (dx, dy), (a, b, c, d) = np.moveaxis(places - at, -1, 0), np.moveaxis(slope.reshape(*at.shape[:-1], 4), -1, 0)
        step = np.stack([d * dx - b * dy, a * dy - c * dx], axis=-1) / (a * d - b * c)[..., None]
        points += step
        if not (largest := np.abs(step).max()) > _MAX_LAST_STEP_PX:
            break
    if not largest <= _MAX_LAST_STEP_PX:
        raise ValueError(f"the motion cannot be inverted: the last step of Newton's method is {largest:.2g} px")
    return points


def star(amplitude: float = 0.5, middle: float = 250.0, width: int = 2000) -> Motion:
    """The wave of the second DIC challenge, whose period grows from left to right (Reu et al., Experimental Mechanics
    62, 2022): v = A cos(2π (y − m)/λ(x)), u = 0.

    amplitude : A [px]
    middle : m, the row with displacement A everywhere [px]
    width : width over which the period grows from 10 to 150 px [px]
    """

    def wave(y: Array, period: Array) -> tuple[Array, Array, Array]:
        turn = 2.0 * np.pi * y / period
        rise = -amplitude * np.sin(turn)
        return amplitude * np.cos(turn), rise * 2.0 * np.pi / period, -rise * turn / period

    return _along_y(wave, middle, width)


def strain_star(strain: float = 0.05, middle: float = 250.0, width: int = 2000) -> Motion:
    """The wave of constant strain: v = ε λ/(2π) sin(2π (y − m)/λ(x)), so that ∂v/∂y is ε in the whole middle row."""

    def wave(y: Array, period: Array) -> tuple[Array, Array, Array]:
        turn = 2.0 * np.pi * y / period
        shape = strain / (2.0 * np.pi) * np.sin(turn)
        return period * shape, strain * np.cos(turn), shape - strain * np.cos(turn) * y / period

    return _along_y(wave, middle, width)


def star_period(x: Array, width: int = 2000) -> Array:
    """The period λ of the stars at columns x [px]."""
    return np.asarray(10.0 + _PERIOD_GROWTH_PX * x / width)


def _along_y(wave: Callable[[Array, Array], tuple[Array, Array, Array]], middle: float, width: int) -> Motion:
    """Motion v along y only; ``wave`` gives v, ∂v/∂y and ∂v/∂λ as functions of y − m and λ."""

    def motion(points: Array) -> tuple[Array, Array]:
        v, by_y, by_period = wave(points[..., 1] - middle, star_period(points[..., 0], width))
        places, slope = points.copy(), np.zeros((*v.shape, 2, 2))
        places[..., 1] += v
        slope[..., 0, 0], slope[..., 1, 1] = 1.0, 1.0 + by_y
        slope[..., 1, 0] = by_period * _PERIOD_GROWTH_PX / width
        return places, slope

    return motion
