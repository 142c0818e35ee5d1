"""Working space for one subset after the other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Bytes, Image, Index
from dicflow.core.correlation.gauss_newton import NormalEquations
from dicflow.core.correlation.sampling import Places, new_places
from dicflow.core.correlation.subset_sums import Pixels
from dicflow.core.correlation.template import lay_out
from dicflow.core.kernels import MAKER

__all__ = ["Work", "working_space"]


class Work(NamedTuple):
    """Working space: the pixels of a subset, and what is made of them.

    ones_like_f : (pixel,) float32; marks : (size, size) uint8; warp : (2, 6)
    collected : (1,) — number of the pixels: all of a square where offsets and weights are those of a whole subset, 0
        where too few were found
    """

    pixels: Pixels
    places: Places
    normal: NormalEquations
    ones_like_f: Image
    marks: Bytes
    warp: Array
    collected: Index


@njit(error_model="numpy", **MAKER)
def working_space(weight: Image, terms: int) -> Work:
    """Working space for subsets with so many terms of the warp per coordinate, laid out for whole ones.

    A kernel that makes it itself knows that its arrays do not overlap, and is faster by a twentieth.
    """
    size, room = len(weight), len(weight) ** 2
    grey, geometry = np.empty((3, room), dtype=np.float32), np.empty((3, room), dtype=np.float32)
    ones_like_f, row_rest = np.ones(room, dtype=np.float32), np.empty(room, dtype=np.int32)
    pixels = Pixels(grey[0], grey[1], grey[2], geometry[0], geometry[1], geometry[2], row_rest)
    lay_out(weight, pixels)
    square, vector = np.empty((2, 2 * terms, 2 * terms)), np.empty((5, 2 * terms))
    of_subset, working = (np.empty(3), np.empty(15), np.empty(3 + 2 * terms)), (vector[2], vector[3:])
    normal = NormalEquations(square[0], square[1], vector[0], vector[1], *of_subset, *working)
    marks = np.empty((size, size), dtype=np.uint8)
    return Work(pixels, new_places(room), normal, ones_like_f, marks, np.zeros((2, 6)), np.full(1, room))
