import numpy as np
import pytest

from dicflow.core.cameras.camera import project, to_right
from dicflow.core.cameras.common_misfit import PlaceErrors, independent_share, shared_part
from tests.stereo_scene import RIG

NOISE, MISFIT_MM = 0.01, 0.01
SHAPE = (60, 60)


def seen(points):
    return project(RIG.left, points), project(RIG.right, to_right(RIG, points))


def plane(depth_mm):
    x, y = np.meshgrid(np.linspace(-8.0, 8.0, SHAPE[1]), np.linspace(-6.0, 6.0, SHAPE[0]))
    return np.stack([x, y, depth_mm + 0.2 * x], axis=-1)


def isotropic(variance):
    return np.broadcast_to(variance * np.array([1.0, 0.0, 1.0]), (*SHAPE, 3))


def share(common, seed=0):
    """Both photographs of a plane whose points are off along it by the same in both, by that share of the variance."""
    rng = np.random.default_rng(seed)
    depth = 0.5 * RIG.left.matrix[0, 0] * 24.0 / RIG.left.size[0]
    points = plane(depth)
    pixel_mm = np.linalg.norm(points[0, 1] - points[0, 0]) / np.linalg.norm(np.diff(seen(points)[0][0, :2], axis=0))
    sigma_px = MISFIT_MM / pixel_mm
    along = np.stack([np.array([1.0, 0.0, 0.2]), np.array([0.0, 1.0, 0.0])])
    moved = points + np.sqrt(common) * MISFIT_MM * rng.normal(size=(*SHAPE, 2)) @ along
    views = []
    for places in seen(moved):
        own = np.hypot(NOISE, np.sqrt(1.0 - common) * sigma_px) * rng.normal(size=places.shape)
        views.append(PlaceErrors(places + own, isotropic(NOISE**2), isotropic(sigma_px**2)))
    return independent_share(RIG, *views)


@pytest.mark.parametrize("common", [0.0, 0.5, 1.0])
def test_the_share_shows_in_the_distances_from_the_epipolar_lines(common):
    assert share(common) == pytest.approx(1.0 - common, abs=0.1)


def test_misfit_counts_as_independent_where_nothing_tells():
    places = np.full((*SHAPE, 2), np.nan)
    unknown = PlaceErrors(places, isotropic(1.0), isotropic(1.0))
    assert independent_share(RIG, unknown, unknown) == 1.0
    exact = PlaceErrors(seen(plane(300.0))[0], isotropic(1.0), isotropic(0.0))
    assert independent_share(RIG, exact, exact) == 1.0


def matrices(covariance):
    xx, xy, yy = np.moveaxis(covariance, -1, 0)
    return np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)


def test_what_two_covariances_share_is_in_both_along_all_directions():
    """And touches one of them along each of two directions, so that it is the largest one."""
    roots = np.random.default_rng(0).normal(size=(2, 300, 2, 2))
    one, other = roots @ np.swapaxes(roots, -1, -2)
    both = matrices(shared_part(*(part[:, [0, 0, 1], [0, 1, 1]] for part in (one, other))))
    left = np.stack([np.linalg.eigvalsh(part - both) for part in (one, other)])
    assert left.min() > -1e-6
    assert (left < 1e-6).sum(axis=(0, 2)).min() >= 2


def test_the_smaller_of_two_like_covariances_is_shared():
    small = np.array([[2.0, -0.5, 1.0]])
    assert shared_part(small, 3.0 * small) == pytest.approx(small)
    assert shared_part(3.0 * small, small) == pytest.approx(small)
    assert shared_part(small, 0.0 * small) == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(shared_part(small, np.nan * small)).all()
