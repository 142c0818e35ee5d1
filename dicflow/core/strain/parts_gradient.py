"""Deformation gradients of a surface whose parts move on their own: no window reaches from one part into another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.parts import Parts
from dicflow.core.strain.deformation_gradient import ErrorShare, SurfaceGradient, surface_gradient
from dicflow.core.strain.surface_strain import jacobian
from dicflow.core.surfaces.part_windows import mixed_windows

__all__ = ["gradient_of_parts", "jacobian_of_parts"]


def gradient_of_parts(
    parts: Parts,
    reference: Array,
    deformed: Array,
    errors: Sequence[ErrorShare],
    window: tuple[int, int],
    degree: int,
    min_share: float = 0.25,
) -> SurfaceGradient:
    """Deformation gradients as by :func:`~dicflow.core.strain.deformation_gradient.surface_gradient`, part by part.

    parts : of the material grid; the other parameters are those of that function

    A window that holds points of several parts is fitted again with the points of its centre's part alone.
    """
    whole = surface_gradient(reference, deformed, errors, window, degree, min_share)
    known = np.asarray(np.isfinite(reference + deformed).all(axis=-1))
    for tiles in mixed_windows(parts, known, window):
        shares = [ErrorShare(tiles.cut_out(share.covariance), share.rho) for share in errors]
        before, after = tiles.cut_out(reference), tiles.cut_out(deformed)
        own = surface_gradient(before, after, shares, window, degree, min_share, tiles.is_centre)
        for field, values in zip(whole, own, strict=True):
            field[tiles.centres] = values
    return whole


def jacobian_of_parts(parts: Parts | None, xyz: Array, window: tuple[int, int], degree: int) -> Array:
    """Derivatives (row, col, 3, 2) of a surface as by ``jacobian``, part by part; None for a single part.

    xyz : (row, col, 3) — points of the material grid
    """
    whole = jacobian(xyz, window, degree)
    for tiles in mixed_windows(parts, np.asarray(np.isfinite(xyz).all(axis=-1)), window):
        whole[tiles.centres] = tiles.centres_of(jacobian(tiles.cut_out(xyz), window, degree))
    return whole
