import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.ndimage import map_coordinates

from dicflow.core.photographs.interpolate import PAD, interpolate, quintic_weights, slopes, spline

RNG = np.random.default_rng(0)
IMAGE = RNG.uniform(0, 255, (40, 53)).astype(np.float32)
ANYWHERE = RNG.uniform((0, 0), (52, 39), (2000, 2))

both = pytest.mark.parametrize("degree", [3, 5])


def polynomial(points, degree):
    x, y = np.moveaxis(points, -1, 0) / 30 - 1
    return 100 + 20 * sum((0.7 * x) ** k * y ** (degree - k) + x**k - 0.5 * y**k for k in range(degree + 1))


def pixels(rows, cols):
    return np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1).astype(float)


@both
def test_equals_the_spline_of_the_mirrored_image(degree):
    expected = map_coordinates(IMAGE.astype(float), ANYWHERE.T[::-1], order=degree, mode="mirror")
    np.testing.assert_allclose(interpolate(spline(IMAGE, degree), ANYWHERE), expected, atol=2e-3)


@both
@pytest.mark.parametrize("shape", [(PAD + 1, 30), (30, PAD + 1), (7, 5)])
def test_small_images_too(degree, shape):
    image = IMAGE[: shape[0], : shape[1]]
    points = RNG.uniform((0, 0), (shape[1] - 1, shape[0] - 1), (100, 2))
    expected = map_coordinates(image.astype(float), points.T[::-1], order=degree, mode="mirror")
    np.testing.assert_allclose(interpolate(spline(image, degree), points), expected, atol=5e-3)


@both
def test_passes_through_the_pixels_to_the_last_row_and_column(degree):
    np.testing.assert_allclose(interpolate(spline(IMAGE, degree), pixels(40, 53)), IMAGE, atol=1e-3)


@both
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float64])
def test_any_grey_levels(degree, dtype):
    image = IMAGE.astype(dtype)
    np.testing.assert_allclose(interpolate(spline(image, degree), pixels(40, 53)), image, atol=1e-3)


@both
def test_polynomials_up_to_its_degree_are_reproduced(degree):
    inside = RNG.uniform(25, 35, (300, 2))  # far from the edges, beyond which a polynomial is not its mirror image
    for power in range(degree + 1):
        image = spline(polynomial(pixels(60, 60), power), degree)
        np.testing.assert_allclose(interpolate(image, inside), polynomial(inside, power), atol=1e-3)


@both
def test_slopes_of_polynomials_are_their_derivatives(degree):
    image, step = spline(polynomial(pixels(60, 60), 3), degree), 1e-4
    for axis, slope in enumerate(slopes(image)):
        shift = step * np.eye(2)[axis]
        around = (polynomial(pixels(60, 60) + shift, 3) - polynomial(pixels(60, 60) - shift, 3)) / (2 * step)
        np.testing.assert_allclose(slope[25:35, 25:35], around[25:35, 25:35], atol=1e-3)


@both
def test_slopes_are_those_of_the_spline(degree):
    image, step = IMAGE.astype(float), 1e-4
    for axis, slope in enumerate(slopes(spline(IMAGE, degree))):
        shift = step * np.eye(2)[axis]
        ahead, behind = (
            map_coordinates(image, np.moveaxis(pixels(40, 53) + s, -1, 0)[::-1], order=degree, mode="mirror")
            for s in (shift, -shift)
        )
        np.testing.assert_allclose(slope, (ahead - behind) / (2 * step), atol=5e-3)


@both
def test_error_falls_with_the_order_of_the_spline(degree):
    errors = []
    for period in (6.0, 12.0):
        wave = np.cos(2 * np.pi * pixels(80, 80)[..., 0] / period + 0.4) * 1000
        points = RNG.uniform(30, 50, (2000, 2))
        truth = np.cos(2 * np.pi * points[:, 0] / period + 0.4) * 1000
        errors.append(np.sqrt(np.mean((interpolate(spline(wave, degree), points) - truth) ** 2)))
    # the least order of degree + 1, a little more where the wave is not long yet
    assert degree + 0.9 < np.log2(errors[0] / errors[1]) < degree + 2.0


def test_points_outside_give_nan():
    around = np.array([[-1e-9, 5], [5, -0.1], [52.001, 5], [5, 39.5], [np.nan, 5], [0, 0], [52, 39]])
    values = interpolate(spline(IMAGE), around)
    assert np.isnan(values).tolist() == [True] * 5 + [False] * 2


def test_the_shape_of_the_points_is_kept():
    assert interpolate(spline(IMAGE), ANYWHERE[:24].reshape(2, 3, 4, 2)).shape == (2, 3, 4)


@pytest.mark.parametrize("t", [0.0, 0.3, 0.5, 0.99])
def test_quintic_weights_are_the_b_splines(t):
    basis = BSpline.basis_element(np.arange(7.0) - 3)
    np.testing.assert_allclose(quintic_weights(np.float32(t)), [basis(t - k) for k in range(-2, 4)], atol=1e-6)
