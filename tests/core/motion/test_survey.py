"""A look at series whose motion, sharpness and content are known."""

import cv2
import numpy as np

from dicflow.core.motion.choice import most_different, moved_steps
from dicflow.core.motion.survey import survey

RNG = np.random.default_rng(4)
PATTERN = cv2.GaussianBlur(RNG.normal(size=(500, 700)), (0, 0), 2.0)
PATTERN = (128.0 + 40.0 * PATTERN / PATTERN.std()).clip(0, 255).astype(np.uint8)


def shifted(x, y, size=(480, 360)):
    """The pattern, moved to the right and down [px]."""
    motion = np.array([[1.0, 0.0, x - 60.0], [0.0, 1.0, y - 60.0]])
    return cv2.warpAffine(PATTERN, motion, size, flags=cv2.INTER_CUBIC)


def test_displacements_of_a_shifted_pattern():
    shifts = np.array([[0.0, 0.0], [0.4, -0.2], [1.7, 0.5], [5.0, 2.25], [30.0, 12.0], [31.5, 12.0]])
    found = survey(shifted(*one) for one in shifts)
    np.testing.assert_allclose(np.median(found.cells, axis=1), shifts, atol=0.08)  # OpenCV moves by 32nds of a pixel
    assert found.cells.shape == (6, 24, 2)


def test_displacements_count_in_pixels_of_the_photograph_whatever_its_size():
    large = (cv2.resize(shifted(x, 0.0), None, fx=3, fy=3, interpolation=cv2.INTER_CUBIC) for x in (0.0, 2.0))
    np.testing.assert_allclose(np.median(survey(large).cells[1], axis=0), [6.0, 0.0], atol=0.2)


def test_levels_and_sharpness():
    sharp = shifted(0.0, 0.0)
    blurred = cv2.GaussianBlur(sharp, (0, 0), 2.0)
    found = survey([sharp, blurred, (sharp.astype(np.uint16) * 257)])
    np.testing.assert_allclose(found.level, [sharp.mean(), blurred.mean(), 257.0 * sharp.mean()])
    assert found.sharpness[1] < 0.7 * found.sharpness[0]
    assert found.sharpness[2] == found.sharpness[0]


def test_photographs_without_features_do_not_move():
    assert not survey(np.full((3, 60, 80), 90, np.uint8)).cells.any()


def test_steps_are_made_where_something_has_moved():
    cells = np.zeros((9, 4, 2))
    cells[:, 2, 0] = [0.0, 0.1, 0.9, 1.1, 1.2, 2.0, 2.2, 2.2, 2.8]
    assert moved_steps(cells, 1.0) == [0, 3, 6, 8]
    assert moved_steps(cells, 10.0) == [0]


def test_the_sharpest_of_photographs_that_differ_most():
    boards = [shifted(40.0 * k, 0.0) for k in range(4)]
    series = [board for board in boards for _ in range(5)]
    series[2::5] = [cv2.GaussianBlur(board, (0, 0), 3.0) for board in boards]
    found = survey(series)
    chosen = most_different(found.thumbs, found.sharpness, np.zeros(20), 10)
    assert sorted(k // 5 for k in chosen) == [0, 1, 2, 3]
    assert not any(k % 5 == 2 for k in chosen)
    assert len(most_different(found.thumbs, found.sharpness, np.zeros(20), 2)) == 2
