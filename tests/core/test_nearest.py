"""The nearest places, against those of scipy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from dicflow.core.nearest import nearest


def _agrees_with_scipy(places: np.ndarray, points: np.ndarray, count: int) -> None:
    distance, index = nearest(places, points, count)
    expected, _ = cKDTree(places).query(points, k=np.arange(1, count + 1))
    np.testing.assert_allclose(distance, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(places[index] - points[:, None], axis=-1), distance, atol=1e-12)
    assert all(len(set(row)) == count for row in index.tolist())


@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 60),
    st.sampled_from([1, 2, 25]),
    st.sampled_from(["square", "line", "lattice", "point", "clusters"]),
)
def test_as_scipy(seed: int, many: int, count: int, shape: str) -> None:
    rng = np.random.default_rng(seed)
    places = rng.uniform(-3.0, 8.0, (many, 2))
    if shape == "line":
        places[:, 1] = 0.3 * places[:, 0] if seed % 2 else 4.0
    elif shape == "lattice":
        places = np.rint(places)
    elif shape == "point":
        places[:] = places[0]
    elif shape == "clusters":
        places[: many // 2] = 1e5 + 1e-3 * places[: many // 2]
    points = np.concatenate([places, rng.uniform(-30.0, 40.0, (20, 2))])
    _agrees_with_scipy(places, points, min(count, many))


def test_many_places() -> None:
    rng = np.random.default_rng(1)
    _agrees_with_scipy(rng.normal(size=(5000, 2)), rng.normal(size=(2000, 2)), 25)


def test_no_points() -> None:
    distance, index = nearest(np.zeros((3, 2)), np.empty((0, 2)), 2)
    assert distance.shape == index.shape == (0, 2)


def test_too_few_places() -> None:
    with pytest.raises(ValueError, match="2 nearest places are wanted of 1"):
        nearest(np.zeros((1, 2)), np.zeros((1, 2)), 2)
