import numpy as np
import pytest
from scenes import grey, texture

from dicflow.core.correlation.judgement import find_points
from dicflow.core.correlation.material import Updating, follow_step, search_directly
from dicflow.core.correlation.points import VIA_REFERENCE_STEP, ReferencePhotograph, carried_points, cropped
from dicflow.core.correlation.search import (
    Search,
    first_photograph,
    points_in_first_photograph,
    target_spline,
)
from dicflow.core.correlation.subsets import Subset
from dicflow.core.correlation.warp import warp_from_gradient
from dicflow.core.photographs.exposure import Photograph
from dicflow.core.photographs.noise import residual_noise
from dicflow.core.status import Status
from dicflow.core.tensors import congruent

pytestmark = pytest.mark.slow

SHAPE, SEARCH = (220, 240), Search(Subset(21), noise=2.0)
AXIS = np.arange(60.0, 161.0, 10.0)
GRID = np.stack(np.meshgrid(AXIS, AXIS), axis=-1)
NEAR = GRID * 0.6 + 44.0
EVERYWHERE = np.ones(SHAPE, dtype=bool)


def image(stretch=1.0, shift=(0.0, 0.0), noise=0.0, seed=0):
    """The texture stretched along x and shifted [px]."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    return Photograph(grey(texture((x - shift[0]) / stretch, y - shift[1]), noise, seed))


def as_reference(found, photograph):
    return ReferencePhotograph(
        photograph, (0, 0), EVERYWHERE, found.warp[..., 0], found.warp, found.inherited_covariance, found.slope
    )


def follow(first, before, target, search=SEARCH):
    """The points in the photograph after the one before, and the next reference step."""
    return follow_step(first, None, search_directly(first, None, before, target, search), search, Updating())


def test_a_cropped_photograph_keeps_what_its_subsets_need():
    first = first_photograph(image(), EVERYWHERE, GRID, SEARCH)
    whole = first._replace(image=image(), origin=(0, 0), region=EVERYWHERE)
    part = cropped(whole, 21)
    assert part.image.grey.shape < whole.image.grey.shape
    x, y = part.origin
    rows, cols = part.image.grey.shape
    np.testing.assert_array_equal(part.image.grey, whole.image.grey[y : y + rows, x : x + cols])
    one, two = (points_in_first_photograph(reference, SEARCH) for reference in (first, part))
    np.testing.assert_allclose(one.covariance, two.covariance, rtol=1e-6)
    lost = cropped(whole._replace(points=np.full(GRID.shape, np.nan)), 21)
    assert lost.image.grey.shape == whole.image.grey.shape


def test_crops_change_no_place():
    """What is cut off a photograph does not move a point by more than rounding does."""
    first = first_photograph(image(), EVERYWHERE, GRID, SEARCH)
    whole = first._replace(image=image(), origin=(0, 0), region=EVERYWHERE)
    target = image(1.05, (4.0, 2.0))
    previous = as_reference(points_in_first_photograph(first, SEARCH), image())
    one, two = (follow(a, previous, target)[0] for a in (first, whole))
    assert np.abs(one.warp[..., 0] - two.warp[..., 0]).max() < 2e-4


def test_carried_points_follow_the_points_around_them():
    first = first_photograph(image(), EVERYWHERE, GRID, SEARCH)
    before = as_reference(points_in_first_photograph(first, SEARCH), image())
    found, reference = follow(first, before, image(1.1, (3.0, 5.0)))
    assert reference is None
    assert found.valid.all()
    between = np.array([[63.0, 71.0], [155.0, 158.0], [52.0, 165.0]])
    np.testing.assert_allclose(carried_points(found, GRID, between), between * (1.1, 1.0) + (3.0, 5.0), atol=0.02)
    none = found._replace(status=np.full(found.status.shape, Status.UNTRACKED, dtype=np.uint8))
    assert np.isnan(carried_points(none, GRID, between)).all()


@pytest.mark.parametrize(("degree", "seed"), [(3, 4), (5, 6)])
def test_residual_noise_is_that_of_the_photographs(degree, seed):
    """A stretch brings all fractions of a pixel, so that the mean share that interpolation leaves is met."""
    search = SEARCH._replace(degree=degree)
    photographs = image(noise=3.0, seed=1), image(1.07, noise=3.0, seed=seed)
    first = first_photograph(photographs[0], EVERYWHERE, GRID, search)
    before = as_reference(points_in_first_photograph(first, search), photographs[0])
    found, _ = follow(first, before, photographs[1], search)
    left = residual_noise(found.residual[found.valid], degree)
    assert left == pytest.approx(np.hypot(3.0, 12**-0.5), rel=0.04)


@pytest.mark.parametrize("route", ["direct", "chained"])
@pytest.mark.parametrize("stretches", [((1.0, 1.0), (1.0, 1.0)), ((1.3, 0.87), (1.2, 0.9)), ((0.7, 0.7), (0.9, 0.9))])
def test_sigma_covers_the_errors_by_either_route(stretches, route):
    """1σ covers 68 % and 2σ 95 % of the errors by the noise of the first photograph, a reference and the target."""
    noise, between, middle = 3.0, np.diag(stretches[0]), np.array([110.0, 110.0])
    motions = np.eye(2), between, np.diag(stretches[1]) @ between
    search, y_x = SEARCH._replace(noise=np.hypot(noise, 12**-0.5)), np.mgrid[: SHAPE[0], : SHAPE[1]]
    offsets = np.stack(y_x[::-1], axis=-1) - middle
    clean = [texture(*np.moveaxis(offsets / np.diag(motion) + middle, -1, 0)) for motion in motions]
    starts = [warp_from_gradient((NEAR - middle) @ m + middle, np.broadcast_to(m, (*NEAR.shape, 2))) for m in motions]
    sizes = []
    for run in range(12):
        images = [Photograph(grey(part, noise, 3 * run + k)) for k, part in enumerate(clean)]
        first = first_photograph(images[0], EVERYWHERE, NEAR, search)
        template, target = points_in_first_photograph(first, search).covariance, target_spline(images[2], search)
        if route == "chained":
            reference = as_reference(find_points(first, target_spline(images[1], search), starts[1], search), images[1])
            found = find_points(reference, target, starts[2], search, VIA_REFERENCE_STEP)
        else:
            found = find_points(first, target, starts[2], search)
        covariance = found.covariance + congruent(found.warp[..., 1:], template)
        sizes.append(np.abs(found.warp[..., 0] - starts[2][..., 0]) / np.sqrt(covariance[..., [0, 2]]))
    assert np.mean(np.array(sizes) < 1.0) == pytest.approx(0.683, abs=0.03)
    assert np.mean(np.array(sizes) < 2.0) == pytest.approx(0.954, abs=0.02)
