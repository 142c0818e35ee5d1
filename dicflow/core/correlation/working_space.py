"""Working space for one subset after the other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from dicflow.core.arrays import Bytes, Image
from dicflow.core.correlation.gauss_newton import NormalEquations
from dicflow.core.correlation.sampling import Places, new_places
from dicflow.core.correlation.subset_sums import Pixels
from dicflow.core.correlation.template import lay_out
from dicflow.core.kernels import INNER

__all__ = ["Work", "working_space"]


class Work(NamedTuple):
    """Working space: pixels of whole and of cut subsets, and what is made of them.

    ones_like_f : (pixel,) float32; marks : (size, size) uint8
    """

    whole: Pixels
    cut: Pixels
    places: Places
    normal: NormalEquations
    ones_like_f: Image
    marks: Bytes


@njit(error_model="numpy", **INNER)
def working_space(weight: Image, terms: int) -> Work:
    """Working space for subsets with so many terms of the warp per coordinate.

    A kernel that makes it itself knows that its arrays do not overlap, and is faster by a twentieth.
    """
    size, room = len(weight), len(weight) ** 2
    grey, geometry = np.empty((3, room), dtype=np.float32), np.empty((6, room), dtype=np.float32)
    ones_like_f, row_rest = np.ones(room, dtype=np.float32), np.empty((2, room), dtype=np.int32)
    whole = Pixels(grey[0], grey[1], grey[2], geometry[0], geometry[1], geometry[2], row_rest[0])
    cut = Pixels(grey[0], grey[1], grey[2], geometry[3], geometry[4], geometry[5], row_rest[1])
    lay_out(weight, whole)
    square, vector = np.empty((2, 2 * terms, 2 * terms)), np.empty((3, 2 * terms))
    normal = NormalEquations(
        square[0], square[1], vector[0], vector[1], np.empty(3), np.empty(15), np.empty(3 + 2 * terms), vector[2]
    )
    return Work(whole, cut, new_places(room), normal, ones_like_f, np.empty((size, size), dtype=np.uint8))
