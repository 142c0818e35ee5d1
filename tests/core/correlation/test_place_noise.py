import numpy as np
import pytest

from dicflow.core.correlation.place_noise import noise_of_places
from dicflow.core.correlation.search import (
    Search,
    correlate_points,
    first_photograph,
    noise_of_residual,
    target_spline,
)
from dicflow.core.correlation.subsets import Subset
from dicflow.core.correlation.warp import warp_from_gradient
from dicflow.core.photographs.exposure import Photograph
from dicflow.core.status import Status
from dicflow.core.synthetic.planar import planar_pair

pytestmark = pytest.mark.slow

SEARCH, SIDE, NOISE = Search(Subset(21)), 320, 3.0
GRID = np.stack(np.meshgrid(*[np.arange(40.0, 281.0, 6.0)] * 2), axis=-1)


def correlation(diameter, width, lost=False):
    """Speckles of diameters in a range [px], stretched to a width along x; and the origin of the template."""
    centre = SIDE / 2.0
    transform = np.diag([width, 1.0, 1.0]) + np.array([[0.0, 0.0, centre * (1.0 - width)], [0, 0, 0], [0, 0, 0]])
    pair = planar_pair((SIDE, SIDE), transform, diameter=diameter, noise=NOISE, seed=2)
    images = [Photograph(image) for image in (pair.reference, pair.deformed)]
    first = first_photograph(images[0], np.ones((SIDE, SIDE), dtype=bool), GRID, SEARCH)
    places = (GRID - centre) * (width, 1.0) + centre
    starts = warp_from_gradient(places, np.broadcast_to(np.diag([width, 1.0]), (*GRID.shape, 2)))
    found = correlate_points(first, target_spline(images[1], SEARCH), starts, SEARCH)
    status = np.full(found.field.status.shape, Status.UNTRACKED, dtype=np.uint8) if lost else found.field.status
    return found._replace(field=found.field._replace(status=status)), first.origin


def by_residuals(found):
    return np.sqrt(np.median(noise_of_residual(found, SEARCH.degree, SEARCH.subset.size)[2]))


@pytest.mark.parametrize("width", [1.0, 0.9, 1.2])
def test_noise_moves_places_as_it_does(width):
    found = noise_of_places(*correlation((4.0, 7.0), width), SEARCH)
    assert found == pytest.approx(np.hypot(NOISE, 12**-0.5), rel=0.1)


def test_speckles_that_are_almost_too_fine_are_no_noise():
    found = correlation((2.5, 3.5), 0.75)
    assert by_residuals(found[0]) > 1.8 * NOISE
    assert noise_of_places(*found, SEARCH) < 1.3 * NOISE


def test_without_a_point_it_is_unknown():
    assert noise_of_places(*correlation((4.0, 7.0), 1.0, lost=True), SEARCH) == np.inf
