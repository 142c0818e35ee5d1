"""Slopes of a surface whose parts move on their own: no window reaches from one part into another."""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.parts import Parts
from dicflow.core.strain.surface_strain import jacobian
from dicflow.core.surfaces.part_windows import mixed_windows

__all__ = ["jacobian_of_parts"]


def jacobian_of_parts(parts: Parts | None, xyz: Array, window: tuple[int, int], degree: int) -> Array:
    """Derivatives (row, col, 3, 2) of a surface as by ``jacobian``, part by part; None for a single part.

    xyz : (row, col, 3) — points of the material grid
    """
    whole = jacobian(xyz, window, degree)
    for tiles in mixed_windows(parts, np.asarray(np.isfinite(xyz).all(axis=-1)), window):
        whole[tiles.centres] = tiles.centres_of(jacobian(tiles.cut_out(xyz), window, degree))
    return whole
