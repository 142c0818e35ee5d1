"""What becomes of points whose subsets hold two motions, and of those around them."""

import numpy as np
import pytest

from dicflow.core.correlation.edges import most_off
from dicflow.core.correlation.follow import Field
from dicflow.core.correlation.judgement import judge
from dicflow.core.correlation.search import Search, correlate_points, first_photograph, target_spline
from dicflow.core.correlation.subsets import Subset
from dicflow.core.correlation.warp import warp_from_gradient
from dicflow.core.photographs.exposure import Photograph
from dicflow.core.status import Status
from dicflow.core.synthetic.planar import planar_pair
from dicflow.core.tensors import congruent

SIDE, NOISE = 240, 2.0
SEARCH = Search(Subset(21), noise=NOISE, counts_misfit=True)
GRID = np.stack(np.meshgrid(*[np.arange(20.0, 221.0, 10.0)] * 2), axis=-1)
SHIFT = np.array([0.3, -0.4])
MISSING = np.s_[:2, :3]


@pytest.fixture(scope="module")
def correlation():
    """Subsets correlated with a photograph in which one half has moved by 0.8 px more; some have no start."""
    move = np.array([[1.0, 0.0, SHIFT[0]], [0.0, 1.0, SHIFT[1]], [0.0, 0.0, 1.0]])
    pair = planar_pair((SIDE, SIDE), move, diameter=(3.5, 4.5), noise=NOISE, seed=5)
    second = pair.deformed.copy()
    second[:, 120:] = planar_pair(
        (SIDE, SIDE), move @ np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.8], [0.0, 0.0, 1.0]]),
        diameter=(3.5, 4.5), noise=NOISE, seed=5,
    ).deformed[:, 120:]  # fmt: skip
    places = GRID.copy()
    places[MISSING] = np.nan
    first = first_photograph(Photograph(pair.reference), np.ones((SIDE, SIDE), dtype=bool), places, SEARCH)
    starts = warp_from_gradient(places + SHIFT, np.broadcast_to(np.eye(2), (*GRID.shape, 2)))
    return first, correlate_points(first, target_spline(Photograph(second), SEARCH), starts, SEARCH)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("counts_misfit", [False, True])
@pytest.mark.parametrize("inherited", [0.0, 1e-4])
def test_points_without_a_value_have_none_in_any_array(correlation, inherited, counts_misfit, threads):
    first, found = correlation
    known = np.where(np.isfinite(first.points[..., :1]), inherited * np.array([1.0, 0.0, 2.0]), np.nan)
    reference = first._replace(inherited_covariance=known if inherited else first.inherited_covariance)
    given = reference.inherited_covariance.copy()
    points = judge(reference, found, SEARCH._replace(counts_misfit=counts_misfit, threads=threads))
    at_edge = np.isin(points.status, (Status.MISFIT, Status.DISCONTINUITY, Status.UNEVEN_LIGHT))
    assert at_edge.any()
    assert not points.valid[MISSING].any()
    assert points.valid.mean() > 0.7
    for name in ("warp", "covariance", "template_covariance", "inherited_covariance", "slope", "residual", "misfit"):
        values = getattr(points, name)
        np.testing.assert_array_equal(np.isfinite(values).reshape(*GRID.shape[:2], -1).all(axis=-1), points.valid)
        assert not np.shares_memory(values, reference.inherited_covariance)
    np.testing.assert_array_equal(reference.inherited_covariance, given)


def test_the_covariance_is_what_reference_steps_noise_and_misfit_give(correlation):
    first, found = correlation
    alone = judge(first, found, SEARCH._replace(counts_misfit=False))
    valid = alone.valid
    assert (alone.misfit[valid] == 0.0).all()
    assert (alone.inherited_covariance[valid] == 0.0).all()
    before = np.broadcast_to([1e-4, 2e-5, 3e-4], alone.covariance.shape)
    later = judge(first._replace(inherited_covariance=before), found, SEARCH._replace(counts_misfit=False))
    carried = congruent(alone.slope, before)
    np.testing.assert_allclose(later.inherited_covariance[valid], carried[valid], rtol=1e-12)
    np.testing.assert_allclose(later.covariance[valid], (alone.covariance + carried)[valid], rtol=1e-9)
    with_misfit = judge(first, found, SEARCH)
    excess = (with_misfit.covariance - alone.covariance - with_misfit.misfit)[..., ::2]
    assert (excess[valid] > -1e-12).all()


def test_places_between_two_motions_are_off_by_what_their_residuals_allow():
    """A motion m leaves ½ m² S, with the mean square S of the slope; a place is off by four of them at most."""
    shape, residual, usual, slope = (1, 2), 3.0, 1.0, 50.0
    warp = warp_from_gradient(np.zeros((*shape, 2)), np.array([np.eye(2), np.diag([2.0, 0.5])])[None])
    field = Field(
        warp, np.full(shape, residual / 100.0), np.zeros(shape, dtype=np.int16), np.zeros(shape, dtype=np.uint8),
        np.zeros((*shape, 3)), np.broadcast_to([100.0, slope], (*shape, 2)),
    )  # fmt: skip
    by_chance = 3.0 * np.sqrt(2.0) / 21 * residual
    motion = np.sqrt(2.0 * (residual - usual + by_chance) / slope)
    found = most_off(field, (np.array([0, 0]), np.array([0, 1])), usual, Subset(21))
    np.testing.assert_allclose(found, 4.0 * motion * np.array([1.0, 2.0]))
