import numpy as np
import pytest

from dicflow.core.correlation.course import Course
from dicflow.core.correlation.points import DIRECT, VIA_REFERENCE_STEP, FoundPoints
from dicflow.core.correlation.warp import warp_from_gradient
from dicflow.core.photographs.exposure import Photograph
from dicflow.core.photographs.noise import Noise
from dicflow.core.photographs.region import rectangle
from dicflow.core.status import Status
from dicflow.kinds.correlation import Correlation, SubsetGrid
from tests.kinds.layouts import stored

DRAW, GRID = np.random.default_rng(7), (3, 4)
PLACES = np.stack(np.meshgrid(10.0 * np.arange(4), 10.0 * np.arange(3)), axis=-1) + 30.0
WARP = warp_from_gradient(PLACES, np.eye(2) + 0.1 * DRAW.normal(size=(*GRID, 2, 2)))
INHERITED, SLOPE = DRAW.uniform(1.0, 2.0, (*GRID, 3)), DRAW.normal(size=(*GRID, 2, 2))
IMAGE = Photograph(DRAW.integers(0, 255, (100, 100)).astype(np.uint8))


def points(route):
    """A product of points, those via a reference step with an inherited covariance and a slope of their own."""
    via, lost = (route == VIA_REFERENCE_STEP)[..., None], (route == 0)[..., None]
    of_place = np.where(lost, np.nan, DRAW.uniform(1.0, 2.0, (*GRID, 3)))
    warp = np.where(lost[..., None], np.nan, WARP)
    found = FoundPoints(
        warp,
        np.full(GRID, 0.01),
        np.ones(GRID, dtype=np.int16),
        np.where(lost[..., 0], np.uint8(Status.MISFIT), np.uint8(Status.VALID)),
        of_place,
        route.astype(np.uint8),
        of_place,
        np.where(via, INHERITED, 0.0 * of_place),
        np.where(via[..., None], SLOPE, warp[..., 1:3]),
        np.ones(GRID),
        0.0 * of_place,
    )
    settings = (Noise(1.0, "given", True), 1.0), [rectangle(25, 25, 65, 55)], SubsetGrid(10, 11, "affine")
    return Correlation.read(stored(Correlation.write(found, Course(PLACES, 0.0 * PLACES), of_place, *settings)))


@pytest.mark.parametrize("via", [0, 5])
def test_a_step_is_a_reference_photograph_with_what_earlier_ones_did_to_its_points(via):
    """What reference steps did is stored for steps that have points via one, and known for the others."""
    route = np.full(GRID, DIRECT)
    route.ravel()[:via], route[2, 3] = VIA_REFERENCE_STEP, 0
    product = points(route)
    assert ("passed" in product) == ("slope" in product) == (via > 0)
    reference, came_via = product.as_reference(IMAGE), (route == VIA_REFERENCE_STEP)[..., None]
    expected = np.where(came_via, INHERITED, 0.0), np.where(came_via[..., None], SLOPE, WARP[..., 1:3]), PLACES.copy()
    for values, known in zip(
        (reference.inherited_covariance, reference.slope, reference.points), expected, strict=True
    ):
        known[2, 3] = np.nan
        np.testing.assert_array_equal(values, known)
