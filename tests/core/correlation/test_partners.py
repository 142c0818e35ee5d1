import numpy as np
import pytest
from stereo_scene import REGION, REST, RIG, State, clean, material, photographs, right_truth

from dicflow.core.correlation.partners import MIN_PARTNERS, Partners, find_partners, right_of_left, starting_warps
from tests import scenes_in_space
from tests.scenes_in_space import cameras
from tests.scenes_in_space.rendering import exposed, with_noise
from tests.scenes_in_space.specimen import bounds

pytestmark = pytest.mark.slow


def seeds(count=14):
    x0, y0, x1, y1 = REGION
    return np.stack(np.meshgrid(np.linspace(x0, x1, count), np.linspace(y0, y1, count)), axis=-1).reshape(-1, 2)


STATES = {
    "at rest": REST,
    "nearer": State(curl=0.3, shift=(0.0, 0.0, -30.0)),
    "farther": State(shift=(2.0, -1.0, 40.0)),
    "askew": State(turn=(0.3, 0.45, 0.1)),
    "askew the other way": State(turn=(-0.2, -0.45, -0.3)),
}


@pytest.mark.parametrize("state", STATES.values(), ids=STATES.keys())
def test_partners_are_right_to_a_pixel_and_their_map_is_smoother(state):
    points = seeds()
    found = find_partners(RIG, *photographs(state, noise=2.0), points)
    assert len(found.left) > 0.7 * len(points)
    truth = right_truth(material(found.left, state), state)
    error = np.linalg.norm(found.right - truth, axis=1)
    assert np.median(error) < 0.7
    assert error.max() < 5.0
    inner = seeds(9)[10:-10]
    position, slope = right_of_left(found, inner)
    truth = right_truth(material(inner, state), state)
    assert np.median(np.linalg.norm(position - truth, axis=1)) < 0.5
    ahead, back = (right_truth(material(inner + np.array([sign, 0.0]), state), state) for sign in (1.0, -1.0))
    assert np.abs(slope[:, :, 0] - (ahead - back) / 2.0).max() < 0.06


@pytest.mark.parametrize("turn_deg", [-45.0, 45.0])
@pytest.mark.parametrize("axis", ["tilt", "nod"])
def test_partners_of_a_plate_turned_far_about_either_axis(axis, turn_deg):
    """Seen from 57.5° by one camera, it is 1.57 times as wide to the other one."""
    selected = scenes_in_space.scene(axis)
    plate = selected.parts[0]._replace(bounds=bounds(12.0, 9.0))
    turned = selected._replace(loads=(turn_deg,), parts=(plate,))
    left, right = (with_noise(exposed(turned, 0, side), turned, (0, 0, side)) for side in (0, 1))
    material = np.stack(np.meshgrid(np.linspace(-9.0, 9.0, 12), np.linspace(-6.0, 6.0, 9)), axis=-1).reshape(-1, 2)
    seen, partners = (cameras.project(view, plate.place(material, turn_deg)) for view in (cameras.LEFT, cameras.RIGHT))
    found = find_partners(cameras.RIG, left, right, seen)
    assert len(found.left) > 0.8 * len(seen)
    nearest = np.linalg.norm(found.left[:, None] - seen, axis=2).argmin(axis=1)
    assert np.median(np.linalg.norm(found.right - partners[nearest], axis=1)) < 0.7


def test_points_outside_the_right_photograph_have_no_partner():
    left, right = photographs(REST)
    hidden = right.copy()
    hidden[:, 300:] = 90
    points = seeds()
    found = find_partners(RIG, left, hidden, points)
    expected = right_truth(material(points), REST)[:, 0] < 270.0
    assert 0.9 * expected.sum() < len(found.left) < expected.sum() + 30
    assert found.right[:, 0].max() < 320.0  # half of the window


def test_unlike_photographs_have_no_partners():
    noise = np.random.default_rng(0).integers(0, 255, (2, 500, 600)).astype(np.uint8)
    found = find_partners(RIG, *noise, seeds(8))
    assert len(found.left) < MIN_PARTNERS
    position, slope = right_of_left(found, seeds(3))
    assert np.isnan(position).all()
    assert np.isnan(slope).all()


def test_underexposed_photographs_have_partners():
    """A pattern underexposed so far that a twentieth of the pixels shows nothing at all."""
    left, right = photographs(REST)
    dark = np.percentile(left, 5)
    clipped = [np.clip(view - dark, 0, 255).astype(np.uint8) for view in (left.astype(float), right.astype(float))]
    assert (clipped[0] == 0).mean() > 0.04
    points = seeds()
    expected = find_partners(RIG, left, right, points)
    assert len(find_partners(RIG, *clipped, points).left) > 0.95 * len(expected.left)


def test_large_photographs_are_searched_small():
    """Twice as many pixels of the same scene, so the rectified images are shrunk."""
    large = [np.kron(view, np.ones((2, 2))).astype(np.uint8) for view in clean(REST)]
    rig = RIG._replace(left=_doubled(RIG.left), right=_doubled(RIG.right))
    points = 2.0 * seeds(8) + 0.5
    found = find_partners(rig, *large, points)
    assert len(found.left) > 0.8 * len(points)
    truth = 2.0 * right_truth(material((found.left - 0.5) / 2.0), REST) + 0.5
    assert np.median(np.linalg.norm(found.right - truth, axis=1)) < 1.5


def _doubled(camera):
    matrix = camera.matrix.copy()
    matrix[:2] *= 2.0
    matrix[:2, 2] += 0.5
    return camera._replace(matrix=matrix, size=(2 * camera.size[0], 2 * camera.size[1]))


def test_starts_go_through_the_left_photograph():
    left = np.array([[[10.0, 1.1, 0.1, 0.01, 0.0, 0.0], [20.0, 0.0, 0.9, 0.0, 0.0, 0.02]]])
    slope = np.array([[[0.8, 0.0], [0.1, 1.0]]])
    start = starting_warps(left, np.array([[50.0, 60.0]]), slope)
    assert start.shape == (1, 2, 3)
    np.testing.assert_allclose(start[0], [[50.0, 0.88, 0.08], [60.0, 0.11, 0.91]])


def test_places_without_a_value_stay_so():
    partners = Partners(seeds(6), seeds(6) + np.array([5.0, 0.0]))
    position, slope = right_of_left(partners, np.array([[200.0, 200.0], [np.nan, 0.0]]))
    np.testing.assert_allclose(position, [[205.0, 200.0], [np.nan, np.nan]])
    np.testing.assert_allclose(slope[0], np.eye(2), atol=1e-9)
