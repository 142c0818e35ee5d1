"""Working space for one subset after the other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Bytes, Image
from dicflow.core.correlation.gauss_newton import NormalEquations
from dicflow.core.correlation.sampling import Places, new_places
from dicflow.core.correlation.subset_sums import Pixels
from dicflow.core.correlation.template import lay_out

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


def working_space(weight: Image, terms: int) -> Work:
    """Working space for subsets with so many terms of the warp per coordinate."""
    size, room = len(weight), weight.size
    grey, geometry = np.empty((3, room), dtype=np.float32), np.empty((6, room), dtype=np.float32)
    ones_like_f, row_rest = np.ones(room, dtype=np.float32), np.empty((2, room), dtype=np.int32)
    whole, cut = (Pixels._make([*grey, *geometry[3 * k : 3 * k + 3], row_rest[k]]) for k in range(2))
    lay_out(weight, whole)
    square, vector = np.empty((2, 2 * terms, 2 * terms)), np.empty((3, 2 * terms))
    sums = np.empty(3), np.empty(15), np.empty(3 + 2 * terms)
    normal = NormalEquations._make([*square, *vector[:2], *sums, vector[2]])
    return Work(whole, cut, new_places(room), normal, ones_like_f, np.empty((size, size), dtype=np.uint8))
