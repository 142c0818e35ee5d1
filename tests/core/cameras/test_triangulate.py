import numpy as np
import pytest
from boards import swapped, verged_rig
from hypothesis import given
from hypothesis import strategies as st

from dicflow.core.cameras.camera import project, to_right
from dicflow.core.cameras.epipolar import epipolar_distance
from dicflow.core.cameras.triangulate import point_covariance, projection_slopes, ray_midpoints, triangulate

RIG = verged_rig()
POINTS = np.random.default_rng(1).uniform([-40, -30, 350], [40, 30, 450], (200, 3))
LEFT, RIGHT = project(RIG.left, POINTS), project(RIG.right, to_right(RIG, POINTS))
SIGMA_LEFT, SIGMA_RIGHT = np.array([[0.04, 0.01], [0.01, 0.09]]), np.array([[0.01, -0.004], [-0.004, 0.02]])


def upper(covariance):
    return np.broadcast_to(covariance[[0, 0, 1], [0, 1, 1]], (len(POINTS), 3))


def noisy(seed, left=SIGMA_LEFT, right=SIGMA_RIGHT):
    generator = np.random.default_rng(seed)
    parts = ((LEFT, left), (RIGHT, right))
    return [xy + generator.multivariate_normal([0, 0], covariance, len(xy)) for xy, covariance in parts]


def test_perfect_points_come_back():
    found = triangulate(RIG, LEFT, RIGHT)
    np.testing.assert_allclose(found.xyz, POINTS, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ray_midpoints(RIG, LEFT, RIGHT), POINTS, rtol=0, atol=1e-9)
    assert found.reprojection.max() < 1e-10


def test_shapes_follow_the_pixels_and_unknown_pixels_give_nan():
    left, right = LEFT.reshape(10, 20, 2).copy(), RIGHT.reshape(10, 20, 2).copy()
    left[2, 3, 0], right[4, 5, 1] = np.nan, np.nan
    found = triangulate(RIG, left, right)
    assert found.xyz.shape == (10, 20, 3)
    assert found.by_left.shape == found.by_right.shape == (10, 20, 3, 2)
    lost = np.isnan(found.reprojection)
    assert lost.sum() == 2
    assert lost[[2, 4], [3, 5]].all()
    assert np.isnan(found.by_left[lost]).all()
    np.testing.assert_allclose(found.xyz[~lost], POINTS.reshape(10, 20, 3)[~lost], atol=1e-9)


def test_slopes_of_the_projection_are_its_differences():
    step = 1e-4
    for axis, shift in enumerate(step * np.eye(3)):
        numeric = (project(RIG.left, POINTS + shift) - project(RIG.left, POINTS - shift)) / (2 * step)
        np.testing.assert_allclose(projection_slopes(RIG.left, POINTS)[..., axis], numeric, atol=1e-6)


def test_slopes_of_the_points_are_their_differences():
    step = 1e-3
    weights = upper(SIGMA_LEFT), upper(SIGMA_RIGHT)
    found = triangulate(RIG, LEFT, RIGHT, *weights)
    for axis, shift in enumerate(step * np.eye(2)):
        by_left = (
            triangulate(RIG, LEFT + shift, RIGHT, *weights).xyz - triangulate(RIG, LEFT - shift, RIGHT, *weights).xyz
        )
        by_right = (
            triangulate(RIG, LEFT, RIGHT + shift, *weights).xyz - triangulate(RIG, LEFT, RIGHT - shift, *weights).xyz
        )
        np.testing.assert_allclose(found.by_left[..., axis], by_left / (2 * step), atol=1e-5)
        np.testing.assert_allclose(found.by_right[..., axis], by_right / (2 * step), atol=1e-5)


def test_no_other_point_fits_the_pixels_better():
    left, right = noisy(3)
    inverse = np.linalg.inv(SIGMA_LEFT), np.linalg.inv(SIGMA_RIGHT)

    def cost(points):
        missed = project(RIG.left, points) - left, project(RIG.right, to_right(RIG, points)) - right
        return sum(np.einsum("ni,ij,nj->n", part, weight, part) for part, weight in zip(missed, inverse, strict=True))

    found = triangulate(RIG, left, right, upper(SIGMA_LEFT), upper(SIGMA_RIGHT))
    least = cost(found.xyz)
    for shift in np.concatenate([np.eye(3), -np.eye(3)]):
        for size in (1e-3, 1e-2, 1e-1):
            assert (cost(found.xyz + size * shift) > least).all()


def test_scatter_is_the_propagated_covariance():
    weights = upper(SIGMA_LEFT), upper(SIGMA_RIGHT)
    exact = triangulate(RIG, LEFT, RIGHT, *weights)
    predicted = point_covariance(exact.by_left, weights[0]) + point_covariance(exact.by_right, weights[1])
    factor = np.linalg.inv(np.linalg.cholesky(predicted))
    runs = [triangulate(RIG, *noisy(seed), *weights).xyz - POINTS for seed in range(60)]
    scaled = np.einsum("nij,rnj->rni", factor, np.array(runs)).reshape(-1, 3)
    np.testing.assert_allclose(scaled.T @ scaled / len(scaled), np.eye(3), atol=4 * np.sqrt(2 / len(scaled)))
    np.testing.assert_allclose(scaled.mean(axis=0), 0, atol=4 / np.sqrt(len(scaled)))


def test_weights_by_the_covariances_scatter_least():
    unequal = np.diag([0.25, 0.25]), np.diag([0.0025, 0.0025])
    left, right = noisy(5, *unequal)
    weighted = triangulate(RIG, left, right, upper(unequal[0]), upper(unequal[1])).xyz - POINTS
    plain = triangulate(RIG, left, right).xyz - POINTS
    assert weighted[:, 1].std() < 0.3 * plain[:, 1].std()


def test_without_full_rank_all_errors_count_alike():
    left, right = noisy(6)
    plain, singular = (
        triangulate(RIG, left, right),
        triangulate(RIG, left, right, np.zeros((200, 3)), upper(SIGMA_RIGHT)),
    )
    np.testing.assert_allclose(singular.xyz, plain.xyz, atol=1e-9)


def test_exchange_of_the_cameras_gives_the_same_points():
    left, right = noisy(7)
    one, other = triangulate(RIG, left, right), triangulate(swapped(RIG), right, left)
    np.testing.assert_allclose(to_right(RIG, one.xyz), other.xyz, atol=1e-7)
    np.testing.assert_allclose(one.reprojection, other.reprojection, atol=1e-9)


def test_reprojection_is_half_the_epipolar_distance_for_equal_scales():
    left, right = noisy(8)
    found = triangulate(RIG, left, right)
    np.testing.assert_allclose(found.reprojection, 0.5 * epipolar_distance(RIG, left, right), rtol=0.05, atol=1e-4)


@given(st.floats(0.1, 10.0))
def test_the_unit_of_length_does_not_matter(scale):
    left, right = noisy(9)
    larger = RIG._replace(translation=scale * RIG.translation)
    np.testing.assert_allclose(
        triangulate(larger, left, right).xyz, scale * triangulate(RIG, left, right).xyz, rtol=1e-9
    )


@pytest.mark.parametrize("shift", [40.0, -40.0])
def test_rays_that_do_not_meet_give_a_reprojection_error(shift):
    found = triangulate(RIG, LEFT, RIGHT + np.array([0.0, shift]))
    assert (found.reprojection > 10.0).all()
