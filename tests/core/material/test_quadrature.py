import numpy as np
import pytest

from dicflow.core.material.quadrature import row_weights, sides_at, smooth_derivatives


@pytest.mark.parametrize("points", [np.arange(9.0), np.array([0.0, 1.0, 4.0, 5.0]), np.array([2.0, 3.0])])
def test_weights_integrate_straight_lines_up_to_the_sides(points):
    weights = row_weights(points, -0.7, 9.2)
    assert weights.sum() == pytest.approx(9.9)
    assert weights @ points == pytest.approx((9.2**2 - 0.7**2) / 2)


def test_a_field_that_is_bent_at_the_sides_is_nearly_integrated():
    """Half a cell is missing on each side, as with points in the middles of cells."""
    points = np.arange(20) + 0.5
    exact = 20 - 20**3 / 12 / 400
    assert row_weights(points, 0.0, 20.0) @ (1 - ((points - 10) / 20) ** 2) == pytest.approx(exact, rel=5e-4)


def test_sides_of_an_outline():
    outline = np.array([[10.0, 0.0], [50.0, 0.0], [60.0, 40.0], [0.0, 40.0]])
    assert sides_at(outline, 20.0) == pytest.approx((5.0, 55.0))
    with pytest.raises(ValueError, match="does not reach y = 41"):
        sides_at(outline, 41.0)


def test_derivatives_of_places_have_little_of_their_noise():
    row, col = np.indices((30, 20)).astype(float)
    places = np.stack([0.5 * col + 1e-4 * row * col, 0.5 * row, 400 + 0.1 * col + 1e-3 * col**2], axis=-1)
    noisy = places + 1e-3 * np.random.default_rng(2).standard_normal(places.shape)
    noisy[5, 5] = np.nan
    found = smooth_derivatives(noisy)
    np.testing.assert_allclose(found[..., 0, 0], 0.5 + 1e-4 * row, atol=4e-4)
    np.testing.assert_allclose(found[..., 2, 0], 0.1 + 2e-3 * col, atol=4e-4)
    np.testing.assert_allclose(found[..., 1, 1], 0.5, atol=4e-4)
