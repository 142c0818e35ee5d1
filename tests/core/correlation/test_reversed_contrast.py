"""Photographs of which no Gaussian makes the sharper one look like the other."""

import cv2
import numpy as np
import pytest

from dicflow.core.correlation.judgement import find_points
from dicflow.core.correlation.search import Search, first_photograph, target_spline
from dicflow.core.correlation.subsets import Subset
from dicflow.core.correlation.warp import warp_from_gradient
from dicflow.core.photographs.exposure import Photograph
from dicflow.core.status import Status
from dicflow.core.synthetic.planar import planar_pair

SIDE = 260
SEARCH = Search(Subset(21), noise=2.0, counts_misfit=True)
GRID = np.stack(np.meshgrid(*[np.arange(50.0, 211.0, 8.0)] * 2), axis=-1)
SHIFT = np.array([0.3, -0.4])


def found_after_motion(length):
    """Points found in a photograph during whose exposure speckles of 4 px moved by so many pixels along x."""
    move = np.array([[1.0, 0.0, SHIFT[0]], [0.0, 1.0, SHIFT[1]], [0.0, 0.0, 1.0]])
    pair = planar_pair((SIDE, SIDE), move, diameter=(3.5, 4.5), noise=0.0, seed=3)
    moving = cv2.blur(pair.deformed.astype(np.float32), (length, 1))
    noise = np.random.default_rng(1).normal(scale=2.0, size=(2, SIDE, SIDE))
    first, second = (
        Photograph((grey + part).astype(np.float32)) for grey, part in zip((pair.reference, moving), noise, strict=True)
    )
    photograph = first_photograph(first, np.ones((SIDE, SIDE), dtype=bool), GRID, SEARCH)
    starts = warp_from_gradient(GRID + SHIFT, np.broadcast_to(np.eye(2), (*GRID.shape, 2)))
    return find_points(photograph, target_spline(second, SEARCH), starts, SEARCH)


def test_motion_by_a_speckle_blurs():
    found = found_after_motion(5)
    assert found.valid.mean() > 0.99
    away = (found.warp[..., 0] - GRID - SHIFT)[found.valid]
    assert np.sqrt((away**2).mean()) < 0.05


@pytest.mark.parametrize("length", [11, 15])
def test_motion_by_more_than_two_speckles_reverses_contrast(length):
    found = found_after_motion(length)
    assert (found.status == Status.BLURRED).mean() > 0.95
    assert found.valid.mean() < 0.02
