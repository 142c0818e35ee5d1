"""Grey levels at the pixels of a subset: those of the spline, for any warp, in whole subsets and in cut ones."""

import numpy as np
import pytest
from numba import njit

from dicflow.core.correlation.sampling import copy_patch, locate_pixels, new_places, sample_runs
from dicflow.core.correlation.warp import apply_warp
from dicflow.core.photographs.interpolate import interpolate, spline

pytestmark = pytest.mark.slow  # the sampling is compiled anew by each process

SIDE, HALF = 90, 10
PHOTOGRAPH = np.random.default_rng(0).uniform(0.0, 255.0, (SIDE, SIDE))
OFFSETS = np.stack(np.meshgrid(*[np.arange(-HALF, HALF + 1)] * 2), axis=-1).reshape(-1, 2)
PLACES = {"middle": (44.3, 45.8), "left top": (16.0, 16.0), "right bottom": (72.9, 72.9)}
GRADIENTS = {
    "none": (1.0, 0.0, 0.0, 1.0),
    "stretched": (1.09, -0.01, 0.03, 0.9),
    "compressed": (0.91, 0.05, -0.03, 1.05),
    "turned": (0.95, 0.3, -0.3, 0.95),
}


def sampled(photograph, warp, kept):
    """Grey levels of the kept pixels (pixel,) of a subset by a warp (2, 6)."""
    xi, eta = (OFFSETS[kept] / HALF).astype(np.float32).T.copy()
    is_inside, is_copied, grey = in_kernel(
        photograph.coefficients, photograph.degree, warp, xi, eta, HALF, row_rest(kept)
    )
    assert is_inside
    assert is_copied
    return grey


@njit
def in_kernel(coefficients, degree, warp, xi, eta, half, rest):
    """Whether all pixels are inside, whether their coefficients are copied, and the grey levels (pixel,) then."""
    places, n = new_places(len(xi)), len(xi)
    is_inside = locate_pixels(warp, coefficients.shape, xi, eta, n, half, places)
    is_copied = is_inside and copy_patch(coefficients, warp, places)
    if is_copied:
        sample_runs(degree, warp, half, rest, n, places)
    return is_inside, is_copied, places.g[:n]


def row_rest(kept):
    """How many of the kept pixels follow each other in a row from each of them on."""
    runs = [[*list(row), False] for row in kept.reshape(2 * HALF + 1, -1)]
    return np.array([row.index(False, j) - j for row in runs for j in np.flatnonzero(row)], dtype=np.int32)


@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("gradient", GRADIENTS.values(), ids=GRADIENTS)
@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
def test_grey_levels_are_those_of_the_spline(degree, gradient, place):
    photograph, bend = spline(PHOTOGRAPH, degree), [0.002, -0.001, 0.001]
    warp = np.array([[place[0], *gradient[:2], *bend], [place[1], *gradient[2:], *bend[::-1]]])
    for kept in (np.ones(len(OFFSETS), dtype=bool), np.random.default_rng(1).uniform(size=len(OFFSETS)) < 0.8):
        expected = interpolate(photograph, apply_warp(warp, OFFSETS[kept]))
        assert sampled(photograph, warp, kept) == pytest.approx(expected, abs=2e-3)  # of 6e-6 px in single precision


@pytest.mark.parametrize(("place", "inside"), [((10.0, 10.0), True), ((9.9, 10.0), False), ((79.0, 80.0), False)])
def test_pixels_beyond_the_border(place, inside):
    xi, eta = (OFFSETS / HALF).astype(np.float32).T.copy()
    warp = np.array([[place[0], 1.0, 0.0, 0.0, 0.0, 0.0], [place[1], 0.0, 1.0, 0.0, 0.0, 0.0]])
    whole = row_rest(np.ones(len(OFFSETS), dtype=bool))
    assert in_kernel(spline(PHOTOGRAPH).coefficients, 5, warp, xi, eta, HALF, whole)[0] is inside


def test_a_subset_with_too_many_coefficients_is_not_copied():
    photograph, half = spline(np.zeros((220, 220))), 95
    xi, eta = (np.random.default_rng(0).uniform(-1.0, 1.0, (2, 500))).astype(np.float32)
    warp = np.array([[110.0, 1.1, 0, 0, 0, 0], [110.0, 0, 1.1, 0, 0, 0]])
    is_inside, is_copied, _ = in_kernel(photograph.coefficients, 5, warp, xi, eta, half, np.ones(500, dtype=np.int32))
    assert is_inside
    assert not is_copied
