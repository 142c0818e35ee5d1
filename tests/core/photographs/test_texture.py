import numpy as np
import pytest

from dicflow.core.photographs.noise import _DIFFERENCE_REACH_PX, _SLOPE_REACH_PX, _fourth_differences, _smooth_slope
from dicflow.core.photographs.texture import (
    in_strips,
    mean_intensity_gradient,
    saturated_share,
    speckle_size,
    speckled_points,
    texture,
    textured_box,
)
from dicflow.core.synthetic.planar import planar_pair


def grain(rows, cols, seed=0):
    return np.kron(np.random.default_rng(seed).uniform(20, 220, (rows // 4, cols // 4)), np.ones((4, 4)))


def test_gradient_of_a_ramp():
    ramp = np.tile(np.arange(0, 240, 3, dtype=np.uint8), (50, 1))
    mask = np.zeros(ramp.shape, dtype=bool)
    mask[10:40, 10:70] = True
    assert mean_intensity_gradient(ramp, mask) == pytest.approx(3.0, abs=1e-4)


@pytest.mark.parametrize("rows", [7, 128, 129, 300])
@pytest.mark.parametrize(
    ("compute", "reach"), [(_smooth_slope, _SLOPE_REACH_PX), (_fourth_differences, _DIFFERENCE_REACH_PX)]
)
def test_strips_are_those_of_the_whole_image(compute, reach, rows):
    image = np.random.default_rng(rows).integers(0, 256, (rows, 40)).astype(np.uint8)
    parts = list(in_strips(image, reach, compute))
    assert [index for part, _ in parts for index in range(rows)[part]] == list(range(rows))
    assert np.array_equal(np.concatenate([values for _, values in parts]), compute(image.astype(np.float32)))


def test_the_gradient_of_an_image_in_strips_is_that_over_all_rows():
    image = np.random.default_rng(1).integers(0, 256, (300, 40)).astype(np.uint8)
    image[128:256] //= 8
    mask = np.zeros(image.shape, dtype=bool)
    found = []
    for rows in (slice(0, 100), slice(100, 300)):
        mask[:], mask[rows] = False, True
        found.append(mean_intensity_gradient(image, mask))
    assert mean_intensity_gradient(image) == pytest.approx((found[0] + 2.0 * found[1]) / 3.0, rel=1e-6)


def test_a_straight_edge_is_no_texture():
    edge = np.full((120, 120), 20, dtype=np.uint8)
    edge[:, 60:] = 230
    assert texture(edge).strength.max() < 1e-3


def test_texture_is_the_same_for_8_12_and_16_bits():
    levels = grain(80, 80)
    strengths = [
        texture((levels / 255 * (2**bits - 1)).round().astype(np.uint16)).strength.mean() for bits in (8, 12, 16)
    ]
    np.testing.assert_allclose(strengths, strengths[0], rtol=0.03)


def test_one_bright_pixel_does_not_change_the_texture_around_others():
    image = (grain(160, 160) / 255 * 2047).astype(np.uint16)
    bright = image.copy()
    bright[80, 80] = 2048
    np.testing.assert_allclose(texture(bright).strength[:10], texture(image).strength[:10], rtol=1e-6)


def test_an_image_full_of_speckles_is_all_pattern():
    assert speckled_points(texture(grain(160, 160).astype(np.uint8))).all()


def test_the_box_holds_the_pattern_and_not_the_background():
    image = np.full((320, 400), 128, dtype=np.uint8)
    image[80:240, 120:280] = grain(160, 160)
    x0, y0, x1, y1 = textured_box(image)
    for found, true in zip((x0, y0, x1, y1), (120, 80, 280, 240), strict=True):
        assert abs(found - true) <= 16
    assert x0 <= 120
    assert y1 >= 240


def test_no_box_without_a_pattern():
    assert textured_box(np.full((100, 100), 90, dtype=np.uint8)) is None


@pytest.mark.parametrize("diameter", [4.0, 8.0, 16.0])
def test_speckles_are_measured(diameter):
    pair = planar_pair((300, 300), (0.0, 0.0), diameter=(diameter, diameter), coverage=0.2, noise=2.0)
    mask = np.zeros((300, 300), dtype=bool)
    mask[10:-10, 10:-10] = True
    assert speckle_size(pair.reference, mask) == pytest.approx(diameter, rel=0.15)


@pytest.mark.slow
def test_a_window_tells_for_a_large_mask():
    """Its place is where the mask is, and the rest of the photograph does not count."""
    pair = planar_pair((1500, 1300), (0.0, 0.0), diameter=(7.0, 7.0), coverage=0.2, noise=2.0)
    grey, mask = pair.reference.copy(), np.zeros((1300, 1500), dtype=bool)
    mask[60:1240, 400:1490] = True
    grey[:, :400] = np.arange(1300)[:, None] % 2 * 255
    assert speckle_size(grey, mask) == pytest.approx(7.0, rel=0.15)


def test_light_that_changes_slowly_makes_no_speckles_larger():
    pair = planar_pair((300, 300), (0.0, 0.0), diameter=(6.0, 6.0), coverage=0.2)
    mask = np.ones((300, 300), dtype=bool)
    shade = 0.4 + 0.6 * np.arange(300) / 299
    assert speckle_size(pair.reference * shade, mask) == pytest.approx(speckle_size(pair.reference, mask), rel=0.1)
    assert np.isnan(speckle_size(np.full((50, 50), 7.0), np.ones((50, 50), dtype=bool)))


@pytest.mark.parametrize(("dtype", "top"), [(np.uint8, 255), (np.uint16, 4095), (np.uint16, 65520)])
def test_saturated_pixels_are_counted(dtype, top):
    image = np.full((10, 10), top // 2, dtype=dtype)
    image[:, :3] = top
    mask = np.zeros((10, 10), dtype=bool)
    mask[:, :6] = True
    assert saturated_share(image, mask) == 0.5
    assert saturated_share(image // 2, mask) == 0.0
