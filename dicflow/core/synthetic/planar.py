"""Pairs of flat speckle images with an exactly known motion in pixels, for one camera."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array, Codes
from dicflow.core.synthetic.render import Extent, GreyLevels, add_noise_and_round, pixel_shares
from dicflow.core.synthetic.speckle import Speckles, darkness, scatter_speckles

__all__ = ["PlanarPair", "planar_pair", "render_planar", "translation"]


_EVEN_LIGHT = GreyLevels(unevenness=0.0, light=(0.0, 0.0))


class PlanarPair(NamedTuple):
    """A reference and a deformed image (height, width); ``transform`` (3, 3) maps pixels of the first to the second."""

    reference: Codes
    deformed: Codes
    transform: Array


def translation(shift: ArrayLike) -> Array:
    """The projective transform (3, 3) that translates by ``shift`` (x, y) [px]."""
    matrix = np.eye(3)
    matrix[:2, 2] = shift
    return matrix


def planar_pair(
    size: tuple[int, int],
    transform: ArrayLike,
    *,
    diameter: tuple[float, float] = (3.0, 7.0),
    coverage: float = 0.45,
    noise: float = 0.0,
    seed: int = 0,
) -> PlanarPair:
    """Images of speckles before and after a projective transform.

    size : (width, height) [px]
    transform : (3, 3) — from reference to deformed pixels, or (2,) — a shift (x, y) [px]
    diameter : of the dots in the reference, least and greatest [px]
    noise : standard deviation of the grey levels
    """
    transform = np.asarray(transform, dtype=float)
    transform = translation(transform) if transform.shape == (2,) else transform
    reach = 0.25 * max(size) + 20.0
    width, height = size[0] + 2.0 * reach, size[1] + 2.0 * reach
    speckles = scatter_speckles((width, height), diameter, 1.0, coverage, seed=seed)
    material_to_reference = translation((0.5 * size[0], -reach))
    images = [
        add_noise_and_round(
            render_planar(speckles, size, matrix @ material_to_reference, Extent(-width / 2, width / 2, 0.0, height)),
            noise,
            key,
        )
        for matrix, key in ((np.eye(3), [seed, 1]), (transform, [seed, 2]))
    ]
    return PlanarPair(images[0], images[1], transform)


def render_planar(
    speckles: Speckles,
    size: tuple[int, int],
    transform: Array,
    extent: Extent,
    levels: GreyLevels = _EVEN_LIGHT,
    order: int = 3,
) -> Array:
    """Image (height, width) of speckles without noise, evenly lit.

    size : (width, height) [px]
    transform : (3, 3) — from material [mm or px] to pixels; a projective one
    """
    pixels = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).astype(float)
    points, slopes = _material_at_pixels(np.asarray(np.linalg.inv(transform), dtype=float), pixels)
    surface, ink = pixel_shares(points, slopes, extent, lambda samples: darkness(speckles, samples), order)
    return np.asarray(levels.background * (1.0 - surface) + levels.paper * (surface - ink) + levels.ink * ink)


def _material_at_pixels(inverse: Array, pixels: Array) -> tuple[Array, Array]:
    """Material points (..., 2) at pixels (..., 2), and the slopes (..., 2, 2) of a projective transform there."""
    numerator = pixels @ inverse[:2, :2].T + inverse[:2, 2]
    denominator = (pixels @ inverse[2, :2] + inverse[2, 2])[..., None]
    points = numerator / denominator
    slopes = (inverse[:2, :2] - points[..., :, None] * inverse[2, :2]) / denominator[..., None]
    return points, slopes
