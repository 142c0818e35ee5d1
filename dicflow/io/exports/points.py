"""A total as a list of measured points, the form that tables of other programs have."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dicflow.core.arrays import Array
from dicflow.engine.product import Product
from dicflow.kinds.total import Total

__all__ = ["Points", "in_space", "points", "principal_strains", "quads"]


class Points(NamedTuple):
    """The n points of a step that have a value.

    xyz : (n, 3) — at the first step [unit]; in one camera's plane the third coordinate is 0
    displacement : (n, 3) — since the first step [unit]
    strain : exx, eyy, exy, e1, e2, each (n,); exy is half the shear angle, e1 ≥ e2 are the principal strains
    unit : mm, or px for a measurement in one camera
    """

    xyz: Array
    displacement: Array
    strain: dict[str, Array]
    unit: str


def points(product: Product) -> Points:
    """The measured points of a total, row by row.

    The principal strains are the product's own if it has them, else those of the tensor (εxx, εyy, εxy).
    """
    total = Total.read(product)
    known = total.known()
    exx, eyy, exy = total["exx"][known], total["eyy"][known], total["gxy"][known] / 2.0
    e1, e2 = (total[name][known] for name in ("e1", "e2")) if "e1" in total else principal_strains(exx, eyy, exy)
    strain = {"exx": exx, "eyy": eyy, "exy": exy, "e1": e1, "e2": e2}
    displacement = np.stack([total[name][known] for name in "UVW"], axis=-1)
    return Points(in_space(total["xyz_reference"][known]), displacement, strain, total.unit)


def principal_strains(exx: Array, eyy: Array, exy: Array) -> tuple[Array, Array]:
    """The larger and the smaller eigenvalue of the plane tensor (εxx, εyy, εxy): Mohr's circle."""
    centre, radius = (exx + eyy) / 2.0, np.hypot((exx - eyy) / 2.0, exy)
    return centre + radius, centre - radius


def in_space(places: NDArray[Any]) -> Array:
    """(n, 2) or (n, 3) places as (n, 3), those of a plane at height 0."""
    return np.pad(places, [(0, 0), (0, 3 - places.shape[1])])


def quads(known: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Cells of a grid whose four corners are known.

    known : (row, col) bool
    Returns (m, 4) — numbers of the corners among the known points, counted row by row, around each cell.
    """
    number = np.where(known, np.cumsum(known).reshape(known.shape) - 1, -1)
    corners = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], axis=-1).reshape(-1, 4)
    return np.asarray(corners[(corners >= 0).all(axis=1)], dtype=np.int64)
