import numpy as np

from dicflow.core.matching.tracking import TrackedSubsets
from dicflow.core.photographs.region import rectangle
from dicflow.core.status import Status
from dicflow.kinds.track import Track, TrackedPoints
from tests.kinds.layouts import layouts, stored

DRAW = np.random.default_rng(4)
POINTS = DRAW.uniform(0, 300, (5, 4, 2))
STATUS = np.full((5, 4), Status.VALID, np.uint8)
COUNTS = np.array([[12, 9, 0]], np.int32)
TRACKED = TrackedSubsets(
    DRAW.normal(size=(1, 3, 3, 3)),
    3 * COUNTS,
    2 * COUNTS,
    COUNTS,
    np.array([[0.2, 0.3, np.nan]]),
    COUNTS == 9,
    COUNTS < 1,
)
STATE = TrackedPoints(POINTS, STATUS, [rectangle(20, 30, 200, 250)])


def write():
    return stored(Track.write(STATE, TRACKED, 5.0, {"points": 20}))


def test_points_and_transforms_come_back_bit_for_bit():
    track = Track.read(write())
    np.testing.assert_array_equal(track["points"], POINTS)
    np.testing.assert_array_equal(track["transforms"], TRACKED.transforms)
    np.testing.assert_array_equal(track["status"], STATUS)
    (outline,) = track.polygons
    np.testing.assert_array_equal(outline.exterior, rectangle(20, 30, 200, 250).exterior)
    assert track.step_size == 5.0
    assert track.summary == {"points": 20}


def test_each_subset_has_its_counts_and_no_residual_without_inliers():
    assert write().attrs["subsets"] == {
        "features": [[36, 27, 0]],
        "matches": [[24, 18, 0]],
        "inliers": [[12, 9, 0]],
        "residual_px": [[0.2, 0.3, None]],
        "filled": [[False, True, False]],
        "empty": [[False, False, True]],
    }


def test_arrays_of_a_track_have_axes_and_units():
    assert layouts(write()) == {
        "points": ("row col component", "px"),
        "status": ("row col", "1"),
        "transforms": ("subset_row subset_col i j", "1"),
    }
