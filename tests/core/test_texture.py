import numpy as np
import pytest

from dicflow.core.texture import mean_intensity_gradient, speckled, texture, textured_box


def grain(rows, cols, seed=0):
    return np.kron(np.random.default_rng(seed).uniform(20, 220, (rows // 4, cols // 4)), np.ones((4, 4)))


def test_gradient_of_a_ramp():
    ramp = np.tile(np.arange(0, 240, 3, dtype=np.uint8), (50, 1))
    mask = np.zeros(ramp.shape, dtype=bool)
    mask[10:40, 10:70] = True
    assert mean_intensity_gradient(ramp, mask) == pytest.approx(3.0, abs=1e-4)


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


def test_an_image_full_of_speckles_is_all_pattern():
    assert speckled(texture(grain(160, 160).astype(np.uint8))).all()


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
