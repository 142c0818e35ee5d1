"""Slopes of polynomials as weighted sums of points: exact fields, textbook variances, gaps."""

import cv2
import numpy as np
import pytest

from dicflow.core.parts import single_part
from dicflow.core.strain.window_fits import WindowedPoints, places_of
from dicflow.core.uncertainty.overlap import independent, overlap

SHAPE, STEP = (40, 30), 5
ROW, COL = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
ONES = np.ones(SHAPE)


def windowed(values=None, weights=ONES, sigma=ONES, min_share=0.0):
    values = np.zeros((*SHAPE, 1)) if values is None else np.asarray(values, dtype=float).reshape(*SHAPE, -1)
    return WindowedPoints(values, weights, sigma, single_part(np.stack([COL, ROW], axis=-1)), min_share)


def slopes(points, window, degree):
    """Slopes (row, col, 2) per column and per row; NaN where unknown."""
    at = places_of(points.weights > 0.0)
    found = np.full((*SHAPE, 2), np.nan)
    found[at[:, 0], at[:, 1]] = points.sums(at, points.slope_weights(at, window, degree))[..., 0]
    return found


@pytest.mark.parametrize(("degree", "window"), [(1, (5, 7)), (2, (7, 5)), (3, (7, 7)), (5, (11, 13))])
def test_polynomials_have_exact_slopes_everywhere(degree, window):
    """Rims and a hole included, with weights that differ."""
    rng = np.random.default_rng(degree)
    powers = [(total - b, b) for total in range(degree + 1) for b in range(total + 1)]
    factors = rng.normal(size=len(powers))
    x, y = COL / 30.0, ROW / 40.0
    field = sum(c * y**a * x**b for c, (a, b) in zip(factors, powers, strict=True))
    by_x = sum(c * b * y**a * x ** max(b - 1, 0) for c, (a, b) in zip(factors, powers, strict=True)) / 30.0
    by_y = sum(c * a * y ** max(a - 1, 0) * x**b for c, (a, b) in zip(factors, powers, strict=True)) / 40.0
    hole = np.hypot(ROW - 20, COL - 15) < 4
    weights = np.where(hole, 0.0, rng.uniform(0.5, 1.5, SHAPE))
    found = slopes(windowed(np.where(hole, 0.0, field), weights), window, degree)
    known = np.isfinite(found[..., 0])
    assert known[~hole].mean() > 0.95
    np.testing.assert_allclose(found[known], np.stack([by_x, by_y], axis=-1)[known], atol=1e-9)


def test_slopes_of_independent_points_have_the_textbook_variance():
    """σ² / Σ x² of a full window of a line, and of the parabola too, since x is orthogonal to 1, x² and y²."""
    at = np.array([[20, 15]])
    for degree in (1, 2):
        points = windowed(sigma=2.0 * ONES)
        found = points.variances(at, points.slope_weights(at, (7, 5), degree), independent())[0]
        np.testing.assert_allclose(found, np.diag([1 / (7 * 10), 1 / (5 * 28)]), atol=1e-15)


def test_slopes_near_an_edge_are_exact_too():
    """Against the quadratic form with all pairs of a window that an edge and a hole cut."""
    rng = np.random.default_rng(5)
    weights, sigmas = rng.uniform(0.5, 1.5, SHAPE), rng.uniform(0.5, 1.5, SHAPE)
    weights[3, 2] = sigmas[3, 2] = 0.0
    rho = overlap(21, STEP, "quadratic")
    row, col = (grid.ravel() for grid in np.mgrid[0:5, 0:6])
    design = np.stack([np.ones(30), col - 2, row - 1, (col - 2) ** 2, (col - 2) * (row - 1), (row - 1) ** 2], axis=1)
    w, s = weights[row, col], sigmas[row, col]
    operator = (np.linalg.inv(design.T @ (w[:, None] * design)) @ design.T * w)[1:3]
    joint = rho.at(row[:, None] - row, col[:, None] - col)
    expected = (operator * s) @ joint @ (operator * s).T / sigmas[1, 2] ** 2
    at, points = np.array([[1, 2]]), windowed(weights=weights, sigma=sigmas)
    found = points.variances(at, points.slope_weights(at, (7, 7), 2), rho)[0]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("lost", [1, 3])
def test_no_window_reaches_across_a_gap(lost):
    """A crack through the whole grid: one column of lost points or three; both sides are stretched on their own."""
    left, gap = COL < 14, (COL >= 14) & (14 + lost > COL)
    field = np.where(left, 0.02 * COL, 5.0 - 0.03 * COL)
    found = slopes(windowed(np.where(gap, 0.0, field), np.where(gap, 0.0, 1.0)), (7, 7), 1)
    np.testing.assert_allclose(found[left], [[0.02, 0.0]] * int(left.sum()), atol=1e-12)
    right = ~left & ~gap
    np.testing.assert_allclose(found[right], [[-0.03, 0.0]] * int(right.sum()), atol=1e-12)


def test_a_single_lost_point_hides_none():
    weights = ONES.copy()
    weights[20, 15] = 0.0
    used = windowed(weights=weights).slope_weights(np.array([[19, 15]]), (7, 7), 1)[0, 1] != 0.0
    assert used.sum() == 49 - 1


def test_no_window_reaches_around_the_end_of_a_gap():
    """Of a gap below the centre that ends two columns to its right, points count up to the diagonal past its end."""
    weights = np.where((ROW == 20) & (COL < 17), 0.0, 1.0)
    used = windowed(weights=weights).slope_weights(np.array([[19, 15]]), (7, 7), 1)[0, 1] != 0.0
    below = np.zeros((7, 7), dtype=bool)
    below[4, 5:], below[5, 6] = True, True
    assert np.array_equal(used[4:], below[4:])
    assert used[:4].all()


@pytest.mark.parametrize("window", [(9, 9), (5, 11), (11, 5)])
def test_windows_hold_the_points_that_a_way_leads_to_ring_by_ring(window):
    known = np.random.default_rng(3).random(SHAPE) < 0.45
    known[20, 15] = known[1, 28] = True
    for row, col in ((20, 15), (1, 28)):
        ring = np.maximum(abs(ROW - row), abs(COL - col))
        reached = ring == 0
        for number in range(1, max(window) // 2 + 1):
            before = (reached & (ring == number - 1)).astype(np.uint8)
            reached |= (cv2.dilate(before, np.ones((3, 3), np.uint8)) > 0) & known & (ring == number)
        reached &= (abs(ROW - row) <= window[0] // 2) & (abs(COL - col) <= window[1] // 2)
        constant = np.array([[[1.0]]])
        at, points = np.array([[row, col]]), windowed(weights=np.where(known, 1.0, 0.0))
        used = np.zeros(SHAPE, dtype=bool)
        offset = np.argwhere(points.functional_weights(at, window, constant)[0, 0] != 0.0)
        corner = np.array([row - window[0] // 2, col - window[1] // 2])
        used[tuple((offset + corner).T)] = True
        assert np.array_equal(used, reached)


def test_too_few_points_are_unknown():
    weights = np.zeros(SHAPE)
    weights[4:7, 4:6] = 1.0
    points, at = windowed(weights=weights), np.array([[5, 5]])
    assert np.isfinite(points.slope_weights(at, (7, 7), 1)).all()
    assert np.isnan(points.slope_weights(at, (7, 7), 2)).all()
    assert np.isnan(points._replace(min_share=0.25).slope_weights(at, (7, 7), 1)).all()
