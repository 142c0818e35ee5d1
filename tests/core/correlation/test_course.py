import numpy as np

from dicflow.core.correlation.course import Course, next_course

NOWHERE = np.full((3, 2), np.nan)
PLACES = np.array([[10.0, 5.0], [20.0, 5.0], [np.nan, np.nan]])
SHIFT = np.array([-8.0, 1.0])


def test_lost_points_keep_their_last_motion():
    course = next_course(Course(PLACES, np.zeros((3, 2))), PLACES, PLACES + SHIFT)
    for steps in (2, 3, 4):
        course = next_course(course, NOWHERE, NOWHERE)
        np.testing.assert_allclose(course.place, PLACES + steps * SHIFT)
        np.testing.assert_allclose(course.expected, PLACES + (steps + 1) * SHIFT)


def test_a_point_found_again_has_no_motion_before_the_next_step():
    lost = next_course(Course(PLACES, np.tile(SHIFT, (3, 1))), NOWHERE, NOWHERE)
    back = next_course(lost, NOWHERE, PLACES)
    np.testing.assert_allclose(back.expected[:2], PLACES[:2])
    np.testing.assert_allclose(next_course(back, PLACES, PLACES + 2.0).expected[:2], PLACES[:2] + 4.0)
