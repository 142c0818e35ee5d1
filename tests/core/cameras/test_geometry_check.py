import numpy as np
import pytest
from boards import swapped, verged_rig
from hypothesis import assume, given
from hypothesis import strategies as st

from dicflow.core.cameras.camera import Camera, Rig, camera_matrix, project, rotation_matrix, to_right
from dicflow.core.cameras.geometry_check import check_order, ray_depths
from dicflow.io.calibrations.read import read_calibration

pytestmark = pytest.mark.slow

RIG = verged_rig()
FIELD = np.random.default_rng(4).uniform([-45, -32, 395], [45, 32, 405], (300, 3))


def seen(rig: Rig, points: np.ndarray, noise: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(7)
    left, right = project(rig.left, points), project(rig.right, to_right(rig, points))
    return left + generator.normal(0, noise, left.shape), right + generator.normal(0, noise, right.shape)


def parallel_rig() -> Rig:
    camera = Camera(camera_matrix(1800.0, (320, 240)), np.zeros(5), (640, 480))
    return Rig(camera, camera, np.eye(3), np.array([-40.0, 0, 0]))


def test_perfect_rays_meet_at_the_depth_of_the_point():
    z0, z1 = ray_depths(RIG, *seen(RIG, FIELD, noise=0.0))
    np.testing.assert_allclose(z0, FIELD[:, 2], rtol=1e-9)
    np.testing.assert_allclose(z1, to_right(RIG, FIELD)[:, 2], rtol=1e-9)


def test_parallel_rays_have_no_depth():
    assert np.isnan(ray_depths(parallel_rig(), [10.0, 20.0], [10.0, 20.0])).all()
    assert ray_depths(RIG, np.zeros((4, 5, 2)), np.zeros((4, 5, 2)))[0].shape == (4, 5)


def test_the_right_order_fits():
    found = check_order(RIG, *seen(RIG, FIELD))
    assert not found.swapped
    assert (found.in_front, found.points) == (1.0, 300)
    # of noise σ in both coordinates of both points, the distance from either line is |N(0, √2 σ)|
    assert found.epipolar_px == pytest.approx(0.6745 * np.sqrt(2.0) * 0.1, rel=0.15)
    assert found.exchanged_epipolar_px > 10 * found.epipolar_px
    assert "in the order of the calibration" in found.text


def test_converging_cameras_betray_a_swap_by_the_epipolar_lines():
    found = check_order(RIG, *seen(RIG, FIELD)[::-1])
    assert found.swapped
    assert found.in_front > 0.9
    assert found.text.startswith("left and right photographs look swapped: in the given order, 300 points lie ")
    assert found.text.endswith("exchange left and right")


def test_parallel_cameras_betray_a_swap_by_points_behind_them():
    rig = parallel_rig()
    assert not check_order(rig, *seen(rig, FIELD)).swapped
    found = check_order(rig, *seen(rig, FIELD)[::-1])
    assert found.swapped
    assert (found.in_front, found.exchanged_in_front) == (0.0, 1.0)
    assert found.exchanged_epipolar_px == pytest.approx(found.epipolar_px, rel=1e-6)


@given(st.floats(-30, 30), st.floats(-8, 8), st.floats(-8, 8), st.booleans(), st.floats(0, 0.3))
def test_random_rigs_recognise_a_swap(vergence, tilt, roll, other_side, wrong):
    rotation = rotation_matrix(np.radians([tilt, vergence, roll]))
    target = np.array([0.0, 0.0, 400.0])
    camera = Camera(camera_matrix(1800.0, (320, 240)), np.zeros(5), (640, 480))
    baseline = np.array([40.0 if other_side else -40.0, 0, 0]) if abs(vergence) < 5 else np.zeros(3)
    rig = Rig(camera, camera, rotation, target - rotation @ target + baseline)
    left, right = seen(rig, FIELD)
    assume(np.isfinite(left).all() and np.isfinite(right).all())
    mismatched = np.arange(len(FIELD)) < wrong * len(FIELD)
    right[mismatched] = right[mismatched][::-1]
    assert not check_order(rig, left, right).swapped
    assert check_order(rig, right, left).swapped


def test_a_swapped_rig_is_a_swap_too():
    assert check_order(swapped(RIG), *seen(RIG, FIELD)).swapped


def test_a_rig_that_does_not_fit_in_any_order_is_not_called_swapped():
    moved = RIG._replace(rotation=rotation_matrix([0.02, 0, 0]) @ RIG.rotation)
    for pair in (seen(RIG, FIELD), seen(RIG, FIELD)[::-1]):
        assert not check_order(moved, *pair).swapped


def test_missing_points_are_left_out():
    left, right = seen(RIG, FIELD)
    left[:100] = np.nan
    assert check_order(RIG, right, left).points == 200
    nothing = check_order(RIG, left[:50], right[:50])
    assert (nothing.swapped, nothing.points) == (False, 0)


def test_a_real_specimen(shared_data):
    folder = shared_data / "d_specimen"
    table = np.genfromtxt(folder / "reference" / "points_0273.csv", delimiter=",", names=True, deletechars="")
    left, right = (np.column_stack([table[x], table[y]])[::20] for x, y in (("x", "y"), ("r2_x", "r2_y")))
    for name in ("calibration_vic3d.xml", "calibration_dice.xml", "reference/points_0273_rig.yaml"):
        rig = read_calibration(folder / name, (1920, 1200)).rig
        found = check_order(rig, left, right)
        assert not found.swapped
        assert found.epipolar_px < 0.2
        other = check_order(rig, right, left)
        assert other.swapped
        assert other.epipolar_px > 1.0
