import numpy as np
import pytest
from scipy.spatial import KDTree

from dicflow.core.synthetic.speckle import darkness, scatter_speckles


@pytest.fixture(scope="module")
def speckles():
    return scatter_speckles((20.0, 60.0), (0.3, 0.7), 0.1, seed=4)


def test_coverage_is_the_dark_share(speckles):
    grid = np.stack(np.meshgrid(np.linspace(-10, 10, 500), np.linspace(0, 60, 1500)), axis=-1)
    assert darkness(speckles, grid).mean() == pytest.approx(0.45, abs=0.02)


def test_dots_have_the_given_sizes_and_stay_in_the_region(speckles):
    assert speckles.radii.min() >= 0.15
    assert speckles.radii.max() <= 0.35
    ends = np.stack(np.meshgrid(np.linspace(-10, 10, 2000), [-1e-6, -0.2, 60.0 + 1e-6, 60.2]), axis=-1)
    assert darkness(speckles, ends).max() == 0.0


def test_dots_lie_at_random_and_hardly_overlap(speckles):
    nearest = KDTree(speckles.centres).query(speckles.centres, k=2)[0][:, 1]
    assert nearest.min() > 0.78 * 0.3
    assert nearest.std() / nearest.mean() > 0.15


def test_the_seed_decides(speckles):
    again = scatter_speckles((20.0, 60.0), (0.3, 0.7), 0.1, seed=4)
    other = scatter_speckles((20.0, 60.0), (0.3, 0.7), 0.1, seed=5)
    assert all(np.array_equal(a, b) for a, b in zip(speckles, again, strict=True))
    assert not np.array_equal(speckles.centres[:10], other.centres[:10])


def test_one_dot_fades_over_its_edge():
    one = scatter_speckles((10.0, 10.0), (2.0, 2.0), 0.4, coverage=1e-3, elongation=1.0)
    assert len(one.radii) == 1
    radial = np.array([0.0, 0.79, 0.9, 1.0, 1.1, 1.21])
    expected = [1.0, 1.0, 0.84375, 0.5, 0.15625, 0.0]
    for direction in ([1.0, 0.0], [0.6, 0.8], [0.0, -1.0]):
        assert darkness(one, one.centres[0] + radial[:, None] * direction) == pytest.approx(expected)


def test_the_index_finds_every_dot_near_a_point(speckles):
    points = np.random.default_rng(1).uniform([-10, 0], [10, 60], (300, 2))
    away = points[:, None] - speckles.centres
    a, b, c = speckles.shapes.T
    form = a * away[..., 0] ** 2 + 2 * b * away[..., 0] * away[..., 1] + c * away[..., 1] ** 2
    inside = np.clip(0.5 + (1.0 - np.sqrt(form)) * speckles.radii / speckles.edge, 0.0, 1.0)
    light = np.prod(1.0 - inside**2 * (3.0 - 2.0 * inside), axis=1)
    assert darkness(speckles, points) == pytest.approx(1.0 - light, abs=1e-12)
