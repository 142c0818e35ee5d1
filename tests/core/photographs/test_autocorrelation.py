"""Autocorrelations against sums over the pixels."""

import numpy as np
import pytest

from dicflow.core.photographs.autocorrelation import autocorrelation, overlap

REACH = (3, 5)


def summed(values: np.ndarray) -> np.ndarray:
    """Σ v(x) v(x + shift), shift by shift."""
    wide = np.pad(values, [(far, far) for far in REACH])
    shape = values.shape
    return np.array(
        [
            [(values * wide[row : row + shape[0], col : col + shape[1]]).sum() for col in range(2 * REACH[1] + 1)]
            for row in range(2 * REACH[0] + 1)
        ]
    )


@pytest.mark.parametrize(("kind", "tolerance"), [(np.float64, 1e-12), (np.float32, 1e-6)])
@pytest.mark.parametrize("shape", [(9, 14), (16, 11)])
def test_autocorrelation(kind, tolerance, shape):
    values = np.random.default_rng(0).normal(0.0, 10.0, shape).astype(kind)
    found, expected = autocorrelation(values, REACH), summed(values.astype(np.float64))
    assert np.abs(found - expected).max() < tolerance * expected.max()


@pytest.mark.parametrize("is_whole", [True, False])
def test_overlap(is_whole):
    inside = np.ones((12, 9))
    if not is_whole:
        inside[4:, 6:] = 0.0
    assert np.abs(overlap(inside, REACH) - summed(inside)).max() < 1e-9
