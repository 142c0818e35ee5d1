import numpy as np
import pytest
from scenes import grey, texture

from dicflow.core.correlate import Subset
from dicflow.core.material import Anchor, Search, Updating, at_rest, carried_by, cropped, first_anchor, follow_step
from dicflow.core.noise import residual_noise
from dicflow.core.status import Status
from dicflow.core.warp import identity

SHAPE, SEARCH = (220, 240), Search(Subset(21), noise=2.0)
AXIS = np.arange(60.0, 161.0, 10.0)
GRID = np.stack(np.meshgrid(AXIS, AXIS), axis=-1)
EVERYWHERE = np.ones(SHAPE, dtype=bool)


def image(stretch=1.0, shift=(0.0, 0.0), noise=0.0, seed=0):
    """The texture stretched along x and shifted [px]."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    return grey(texture((x - shift[0]) / stretch, y - shift[1]), noise, seed)


def anchor_of(found, photograph):
    return Anchor(photograph, (0, 0), EVERYWHERE, found.warp[..., 0], found.warp, found.covariance)


def test_an_anchor_keeps_what_its_subsets_need():
    whole = Anchor(image(), (0, 0), EVERYWHERE, GRID, identity(GRID), np.zeros((*GRID.shape[:2], 3)))
    part = cropped(whole, 21)
    assert part.image.shape < whole.image.shape
    x, y = part.origin
    np.testing.assert_array_equal(part.image, whole.image[y : y + part.image.shape[0], x : x + part.image.shape[1]])
    one, two = (at_rest(anchor, SEARCH) for anchor in (first_anchor(image(), EVERYWHERE, GRID, SEARCH), part))
    np.testing.assert_allclose(one.covariance, two.covariance, rtol=1e-6)
    lost = cropped(whole._replace(points=np.full(GRID.shape, np.nan)), 21)
    assert lost.image.shape == whole.image.shape


def test_crops_change_no_place():
    """What is cut off a photograph does not move a point by more than rounding does."""
    first = first_anchor(image(), EVERYWHERE, GRID, SEARCH)
    whole = first._replace(image=image(), origin=(0, 0), usable=EVERYWHERE)
    target = image(1.05, (4.0, 2.0))
    one, two = (
        follow_step(a, None, anchor_of(at_rest(first, SEARCH), image()), target, SEARCH, Updating())[0]
        for a in (first, whole)
    )
    assert np.abs(one.warp[..., 0] - two.warp[..., 0]).max() < 2e-4


def test_points_around_carry_others_along():
    first = first_anchor(image(), EVERYWHERE, GRID, SEARCH)
    before = anchor_of(at_rest(first, SEARCH), image())
    found, reference = follow_step(first, None, before, image(1.1, (3.0, 5.0)), SEARCH, Updating())
    assert reference is None
    assert found.valid.all()
    between = np.array([[63.0, 71.0], [155.0, 158.0], [52.0, 165.0]])
    np.testing.assert_allclose(carried_by(found, first, between), between * (1.1, 1.0) + (3.0, 5.0), atol=0.02)
    none = found._replace(status=np.full(found.status.shape, Status.UNTRACKED, dtype=np.uint8))
    assert np.isnan(carried_by(none, first, between)).all()


@pytest.mark.parametrize(("degree", "seed"), [(3, 4), (5, 6)])
def test_noise_that_correlation_leaves(degree, seed):
    """A stretch brings all fractions of a pixel, so that the mean share that interpolation leaves is met."""
    search = SEARCH._replace(degree=degree)
    photographs = image(noise=3.0, seed=1), image(1.07, noise=3.0, seed=seed)
    first = first_anchor(photographs[0], EVERYWHERE, GRID, search)
    before = anchor_of(at_rest(first, search), photographs[0])
    found, _ = follow_step(first, None, before, photographs[1], search, Updating())
    left = residual_noise(photographs[0], GRID[found.valid], found.znssd[found.valid], 21, degree)
    assert left == pytest.approx(np.hypot(3.0, 12**-0.5), rel=0.04)
