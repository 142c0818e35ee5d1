import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dicflow.core.correlation.warp import TERMS, apply_warp, gradient, identity, recentred, warp_from_gradient

number = st.floats(-2.0, 2.0)
vector = st.tuples(st.floats(-30, 30), st.floats(-30, 30)).map(np.array)
shapes = pytest.mark.parametrize("shape_function", ["affine", "quadratic"])


@st.composite
def warps(draw):
    terms = draw(st.sampled_from(sorted(TERMS.values())))
    scale = np.array([100.0, 1.0, 1.0, 0.01, 0.01, 0.01])[:terms]
    return np.array(draw(st.lists(number, min_size=2 * terms, max_size=2 * terms))).reshape(2, terms) * scale


@shapes
def test_identity_leaves_every_point(shape_function):
    centres, offsets = np.array([[3.0, 4.0], [50.0, 7.0]]), np.array([[1.0, -2.0], [9.0, 5.0]])
    warp = identity(centres, shape_function)
    assert warp.shape == (2, 2, TERMS[shape_function])
    np.testing.assert_array_equal(apply_warp(warp, offsets), centres + offsets)
    np.testing.assert_array_equal(gradient(warp), np.broadcast_to(np.eye(2), (2, 2, 2)))


@shapes
def test_gradient_is_what_the_warp_was_made_of(shape_function):
    slope = np.array([[1.1, 0.2], [-0.3, 0.9]])
    warp = warp_from_gradient([5.0, 6.0], slope, shape_function)
    np.testing.assert_array_equal(gradient(warp), slope)
    np.testing.assert_allclose(apply_warp(warp, [1.0, 2.0]), [5 + 1.1 + 0.4, 6 - 0.3 + 1.8])


def test_columns_are_the_monomials():
    expected = [1.0, 2.0, 3.0, 4.0, 6.0, 9.0]
    for column, monomial in enumerate(expected):
        warp = np.zeros((2, 6))
        warp[1, column] = 1.0
        np.testing.assert_array_equal(apply_warp(warp, [2.0, 3.0]), [0.0, monomial])


@given(warps(), vector)
def test_gradient_is_the_derivative(warp, offset):
    step = 1e-3
    columns = [(apply_warp(warp, offset + d) - apply_warp(warp, offset - d)) / (2 * step) for d in step * np.eye(2)]
    np.testing.assert_allclose(gradient(warp, offset), np.stack(columns, axis=-1), atol=1e-7)


@given(warps(), vector, vector)
def test_recentred_is_the_same_motion(warp, shift, offset):
    moved = recentred(warp, shift)
    np.testing.assert_allclose(apply_warp(moved, offset), apply_warp(warp, shift + offset), atol=1e-8)
    np.testing.assert_allclose(gradient(moved, offset), gradient(warp, shift + offset), atol=1e-10)


@given(warps(), vector, vector)
def test_recentring_twice_is_recentring_once(warp, first, second):
    np.testing.assert_allclose(recentred(recentred(warp, first), second), recentred(warp, first + second), atol=1e-8)
    np.testing.assert_allclose(recentred(recentred(warp, first), -first), warp, atol=1e-8)


@pytest.mark.parametrize("terms", [3, 6])
def test_one_warp_at_many_offsets_and_many_warps_at_their_own(terms):
    rng = np.random.default_rng(1)
    many, offsets = rng.normal(size=(5, 2, terms)), rng.normal(size=(5, 2))
    for function in (apply_warp, gradient, recentred):
        each = [function(warp, offset) for warp, offset in zip(many, offsets, strict=True)]
        np.testing.assert_allclose(function(many, offsets), each)
        np.testing.assert_allclose(function(many[0], offsets), [function(many[0], offset) for offset in offsets])


def test_arguments_are_not_modified():
    warp = np.random.default_rng(2).normal(size=(2, 6))
    before = warp.copy()
    gradient(warp, [3.0, 4.0])
    recentred(warp, [3.0, 4.0])
    np.testing.assert_array_equal(warp, before)
