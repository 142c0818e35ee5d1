import numpy as np
import pytest
from scenes import grey, rectified_plane, texture

from dicflow.core.matching.disparity import MatchingParameters, box_around, disparity_range, match_rows
from dicflow.core.matching.subpixel import refine_disparity
from dicflow.core.status import Status
from dicflow.core.surfaces.depth import is_background

pytestmark = pytest.mark.slow

SHAPE = (160, 400)
INNER = np.s_[20:-20, 70:-50]


def whole(image):
    return 0, 0, image.shape[1], image.shape[0]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_perfect_plane(dtype):
    left, right, truth = rectified_plane(SHAPE, 20.0, 0.01, 0.004, dtype=dtype)
    found = match_rows(left, right, whole(left), (8, 40), MatchingParameters())
    error = (found.disparity - truth)[INNER]
    assert found.disparity.dtype == np.float32
    assert found.status.dtype == np.uint8
    assert np.isfinite(error).all()
    assert np.abs(error).max() < 0.03
    assert error.std() < 0.005


def test_noisy_plane_errs_as_theory_says():
    """σ² = (σ_left² + σ_right²) / (n · mean squared slope), for a window of n pixels (Pan et al. 2008)."""
    sigma, window = 4.0, 21
    left, right, truth = rectified_plane((300, 500), -7.3, -0.01, 0.0, noise=sigma)
    found = match_rows(left, right, whole(left), (-24, 8), MatchingParameters(refine_px=window))
    y, x = np.mgrid[:300, :500].astype(float)
    slope = np.gradient(texture(x, y), axis=1)
    expected = np.sqrt(2.0 * sigma**2 / (window**2 * np.mean(slope**2)))
    assert (found.disparity - truth)[INNER].std() == pytest.approx(expected, rel=0.35)


def test_refined_disparities_are_not_biased_towards_whole_pixels():
    """Semi-global matching alone errs by 0.1 px and more, in step with the fraction of the disparity."""
    left, right, truth = rectified_plane((200, 500), 12.0, 0.012, 0.0, noise=2.0)
    found = match_rows(left, right, whole(left), (0, 32), MatchingParameters())
    error, phase = (found.disparity - truth)[INNER], np.floor(truth[INNER] % 1.0 * 10)
    bias = [error[phase == tenth].mean() for tenth in range(10)]
    assert np.abs(bias).max() < 0.01


def test_swapped_images_give_the_mirrored_disparity():
    left, right, _ = rectified_plane(SHAPE, 20.0, 0.0, 0.004)
    found = match_rows(left, right, whole(left), (8, 40), MatchingParameters())
    other = match_rows(right, left, whole(left), (-40, -8), MatchingParameters())
    cols = np.round(np.arange(SHAPE[1]) - 20.0 - 0.004 * 80).astype(int)
    back = other.disparity[80, cols[70:-50]]
    np.testing.assert_allclose(back, -found.disparity[80, 70:-50], atol=0.02)


def test_a_part_gives_the_same_as_the_whole():
    left, right, _ = rectified_plane(SHAPE, 20.0, 0.01, 0.004)
    found = match_rows(left, right, whole(left), (8, 40), MatchingParameters())
    part = match_rows(left, right, (120, 30, 280, 130), (8, 40), MatchingParameters())
    assert part.origin == (120, 30)
    assert part.disparity.shape == (100, 160)
    np.testing.assert_allclose(part.disparity[15:-15, 15:-15], found.disparity[45:115, 135:265], atol=0.02)


def test_status_of_pixels_without_pattern_or_partner():
    left, right, _ = rectified_plane(SHAPE, 20.0, 0.0, 0.0, noise=0.5)
    left[:, 200:280] = grey(np.full((SHAPE[0], 80), 90.0), 0.5)
    y, x = np.mgrid[: SHAPE[0], :60].astype(float)
    left[40:120, 100:160] = grey(texture(x, y, seed=99)[:80], 0.5)
    found = match_rows(left, right, whole(left), (8, 40), MatchingParameters())
    assert (found.status[:, 215:265] == Status.LOW_TEXTURE).all()
    strange = found.status[50:110, 110:150]
    assert np.isin(strange, [Status.NO_MATCH, Status.LEFT_RIGHT, Status.SPECKLE]).mean() > 0.8
    assert (found.status[INNER][:, -60:] == Status.VALID).all()
    np.testing.assert_array_equal(np.isfinite(found.disparity), found.status == Status.VALID)


@pytest.mark.parametrize("offset", [-130.0, 3.0, 64.0])
def test_range_holds_the_disparities_and_little_more(offset):
    left, right, truth = rectified_plane((240, 600), offset, 0.02, 0.01, noise=2.0)
    low, high = disparity_range(left, right, np.ones(left.shape, bool))
    assert (high - low) % 16 == 0
    assert low <= truth[:, 140:-140].min()
    assert high > truth[:, 140:-140].max()
    assert high - low <= 48


def test_range_depends_on_the_region_only():
    near, far = (rectified_plane((200, 600), offset, 0.0, 0.0, noise=1.0) for offset in (90.0, 10.0))
    left, right = (np.vstack([a, b]) for a, b in zip(near[:2], far[:2], strict=True))
    mask = np.zeros(left.shape, bool)
    mask[220:380] = True
    low, high = disparity_range(left, right, mask)
    assert low < 10 < high < 60
    low, high = disparity_range(left, right, np.ones(left.shape, bool))
    assert low < 10 < 90 < high


def test_no_range_without_features():
    plain = np.full((100, 200), 90, np.uint8)
    assert disparity_range(plain, plain, np.ones(plain.shape, bool)) is None
    assert disparity_range(plain, plain, np.zeros(plain.shape, bool)) is None


def test_box_is_cut_to_the_image():
    assert box_around((10.4, 20.6, 50.2, 60.0), 5.0, (100, 200)) == (5, 15, 57, 66)
    assert box_around((-30.0, -30.0, 500.0, 500.0), 5.0, (100, 200)) == (0, 0, 200, 100)
    assert box_around((210.0, 10.0, 220.0, 20.0), 5.0, (100, 200)) is None


def test_refinement_follows_a_curved_surface():
    """The warp takes on slope and curvature, so that a parabola is found without a window's usual flattening."""
    y, x = np.mgrid[:120, :300].astype(float)
    truth = 5.0 + 2e-4 * (x - 150.0) ** 2
    place = np.broadcast_to(np.linspace(-40, 340, 4000), (120, 4000))
    partner = place - (5.0 + 2e-4 * (place - 150.0) ** 2)
    sources = np.interp(x[0], partner[0], place[0])[None].repeat(120, axis=0)
    left, right = texture(x, y).astype(np.float32), texture(sources, y).astype(np.float32)
    start = np.round(truth * 2.0) / 2.0
    start[50:60, 100:110] = np.nan
    found = refine_disparity(left, right, start.astype(np.float32), 21, iterations=3).disparity
    known = np.isfinite(start)
    np.testing.assert_array_equal(np.isfinite(found), known)
    error = (found - truth)[25:-25, 60:-60][known[25:-25, 60:-60]]
    assert np.abs(error).max() < 0.03
    assert abs(error.mean()) < 0.002


def test_refinement_does_not_depend_on_contrast_and_brightness():
    left, right, truth = rectified_plane(SHAPE, 6.0, 0.01, 0.0)
    start = (truth + 0.3).astype(np.float32)
    found = refine_disparity(left.astype(np.float32), right.astype(np.float32), start).disparity
    other = refine_disparity(left.astype(np.float32), 0.4 * right.astype(np.float32) + 50.0, start).disparity
    np.testing.assert_allclose(other[INNER], found[INNER], atol=2e-3)
    assert np.abs((found - truth)[INNER]).max() < 0.02


def test_correlation_distinguishes_noise_from_pattern():
    """ρ = signal² / (signal² + σ²) for equal independent noise in both images."""
    left, right, truth = rectified_plane((200, 500), 6.0, 0.0, 0.0, noise=25.0)
    found = refine_disparity(left.astype(np.float32), right.astype(np.float32), truth.astype(np.float32)).correlation[
        INNER
    ]
    signal = texture(*np.mgrid[:500, :200].astype(float)).var()
    assert np.nanmean(found) == pytest.approx(signal / (signal + 25.0**2), abs=0.05)
    strange = np.random.default_rng(3).normal(127, 40, right.shape).astype(np.float32)
    assert (
        abs(refine_disparity(left.astype(np.float32), strange, truth.astype(np.float32)).correlation[INNER].mean())
        < 0.1
    )


def test_background_lies_off_the_surface():
    y, x = np.mgrid[:80, :60].astype(float)
    depth = 500.0 + 0.02 * x - 0.01 * y + 1e-3 * (x - 30.0) ** 2 + np.random.default_rng(0).normal(0, 0.02, x.shape)
    depth[:, :8] += 40.0
    depth[10:14, 30:40] -= 9.0
    depth[40, 40] = np.nan
    far = is_background(depth)
    truth = np.zeros(depth.shape, bool)
    truth[:, :8], truth[10:14, 30:40] = True, True
    np.testing.assert_array_equal(far, truth)
    np.testing.assert_array_equal(is_background(depth, 20.0)[10:14, 30:40], False)


def test_a_specimen_that_is_not_quadratic_is_not_cut():
    x = np.linspace(-1.0, 1.0, 200)
    depth = np.broadcast_to(400.0 + 0.5 * np.sin(9.0 * x), (150, 200))
    assert not is_background(depth).any()


def test_too_few_points_have_no_background():
    depth = np.full((20, 20), np.nan)
    depth[3, :5] = [400.0, 400.0, 900.0, 400.0, 400.0]
    assert not is_background(depth).any()
