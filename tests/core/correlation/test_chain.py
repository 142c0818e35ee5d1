import numpy as np
import pytest

from dicflow.core.correlation.chain import chained, uncancelled_noise
from dicflow.core.correlation.warp import TERMS, apply_warp, gradient
from dicflow.core.tensors import congruent

RNG = np.random.default_rng(4)


def warps(terms, n=20):
    """Random warps with strong gradients and weak curvature."""
    warp = RNG.normal(0.0, 1e-3, (n, 2, terms))
    warp[..., 0] = RNG.uniform(100.0, 200.0, (n, 2))
    warp[..., 1:3] = np.eye(2) + RNG.normal(0.0, 0.2, (n, 2, 2))
    return warp


@pytest.mark.parametrize("terms", TERMS.values())
def test_chain_goes_through_both(terms):
    first, second = warps(terms), warps(terms)
    centres = np.rint(first[..., 0])
    total, slope = chained(first, second, centres)
    np.testing.assert_allclose(total[..., 0], apply_warp(second, first[..., 0] - centres))
    np.testing.assert_allclose(slope, gradient(second, first[..., 0] - centres))
    for size, order in ((1.0, 3), (0.1, 3)):
        offset = RNG.uniform(-size, size, (20, 2))
        through = apply_warp(second, apply_warp(first, offset) - centres)
        np.testing.assert_allclose(apply_warp(total, offset), through, atol=1e-4 * size**order)


def test_slope_is_that_of_the_composed_map():
    first, second = warps(6), warps(6)
    centres = np.rint(first[..., 0])
    step = 1e-4
    places = [apply_warp(first, (sign * step, 0.0)) for sign in (1, -1)]
    difference = (apply_warp(second, places[0] - centres) - apply_warp(second, places[1] - centres)) / (2 * step)
    np.testing.assert_allclose(gradient(chained(first, second, centres).warp)[..., 0], difference, rtol=1e-6, atol=1e-8)


def test_affine_chain_has_the_product_of_gradients():
    first, second = warps(3), warps(3)
    total = chained(first, second, np.rint(first[..., 0])).warp
    np.testing.assert_allclose(gradient(total), gradient(second) @ gradient(first))


def test_covariance_transforms_as_a_tensor():
    matrix = RNG.normal(size=(5, 2, 2))
    root = RNG.normal(size=(5, 2, 2))
    full = root @ np.swapaxes(root, 1, 2)
    packed = np.stack([full[:, 0, 0], full[:, 0, 1], full[:, 1, 1]], axis=-1)
    expected = matrix @ full @ np.swapaxes(matrix, 1, 2)
    found = congruent(matrix, packed)
    np.testing.assert_allclose(found, np.stack([expected[:, 0, 0], expected[:, 0, 1], expected[:, 1, 1]], axis=-1))


@pytest.mark.parametrize("terms", [3, 6])
@pytest.mark.parametrize("stretches", [(1.0, 1.0), (1.5, 0.8), (0.7, 0.8)])
def test_noise_of_a_reference_step_cancels_in_part(terms, stretches):
    """The kernel of the subset laid out in the reference, less that of the first subset carried there."""
    half = 30.5
    x, y = np.meshgrid(*[np.arange(-60, 61)] * 2)

    def kernel(x, y):
        curved = 14 / 15 * half**2 - x**2 - y**2 if terms == 6 else 1.0
        return curved * (np.maximum(np.abs(x), np.abs(y)) <= half)

    here = kernel(x, y)
    there = kernel(x / stretches[0], y / stretches[1]) / np.prod(stretches)
    expected = ((here - there) ** 2).sum() / (here**2).sum()
    found = uncancelled_noise(np.diag(stretches), terms, 5)
    assert found == pytest.approx(expected, abs=0.05)
    assert found >= -1e-9
