import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from dicflow.engine.hashing import canonical_json, digest_array, digest_file, digest_json, is_digest, plain

NUMBERS = hnp.arrays(st.sampled_from(["<f8", "<i4", "|u1"]), hnp.array_shapes(min_dims=0, max_dims=3, min_side=0))


def test_canonical_json_has_one_spelling():
    assert canonical_json({"b": [1, 2.5], "a": "é"}) == '{"a":"é","b":[1,2.5]}'.encode()


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_canonical_json_refuses_what_equals_nothing(value):
    with pytest.raises(ValueError, match="JSON"):
        canonical_json({"a": value})


def test_canonical_json_refuses_objects():
    with pytest.raises(TypeError):
        digest_json({"a": object()})


def test_golden_digests():
    """Digests are names that stores keep for years."""
    field = np.arange(6, dtype=np.float64).reshape(2, 3)
    assert digest_json({"a": 1}) == "sha256:015abd7f5cc57a2dd94b7590f04ad8084273905ee33ec5cebeae62276a97f862"
    assert digest_array(field) == "sha256:03c1219abe9c659e0436d9555687aa1ec8f9766fb892fb9d0d7fffb5f14e0b70"


@given(NUMBERS)
def test_digest_array_sees_values_not_layout(array):
    assert digest_array(np.array(array, order="F")) == digest_array(array)
    assert digest_array(array.astype(array.dtype.newbyteorder(">"))) == digest_array(array)
    assert digest_array(np.stack([array, array])[0]) == digest_array(array)


def test_digest_array_sees_shape_dtype_and_values():
    zeros = np.zeros((2, 3))
    others = [zeros.T, zeros.astype(np.float32), zeros.astype(np.int64), zeros + 1e-300, zeros[:1]]
    assert len({digest_array(a) for a in [zeros, *others]}) == 6


def test_digest_array_refuses_objects():
    with pytest.raises(TypeError, match="object"):
        digest_array(np.array([object()]))


def test_digest_file_is_that_of_its_bytes(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    assert digest_file(tmp_path / "a").endswith("f20015ad")


def test_only_digests_are_digests():
    assert is_digest("sha256:" + "0" * 64)
    assert not any(is_digest(text) for text in ("sha256:../../x", "sha256:" + "0" * 63, "md5:" + "0" * 64, None, 3))


def test_plain_gives_json_values():
    value = {"a": (1, np.float32(0.5)), "b": np.int64(3), "c": math.nan, "d": np.float64(math.inf), "e": np.bool_(True)}
    assert plain(value) == {"a": [1, 0.5], "b": 3, "c": None, "d": None, "e": True}


@pytest.mark.parametrize("value", [{1: 2}, {"a": np.zeros(3)}, {"a": {3}}])
def test_plain_refuses_the_rest(value):
    with pytest.raises(TypeError):
        plain(value)
