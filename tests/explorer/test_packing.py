"""Codes of numbers: within half a quantum, gaps stay gaps, and packing loses nothing."""

from __future__ import annotations

import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from dicflow.explorer.packing import LINEAR_CODES, LinearScale, LogScale, blob_name, packed, unpacked

FINITE = st.floats(-1e6, 1e6)


@given(arrays(float, array_shapes(min_dims=2, max_dims=2), elements=st.one_of(FINITE, st.just(np.nan))))
def test_a_value_differs_by_at_most_half_a_quantum_and_a_gap_stays_one(values):
    known = values[np.isfinite(values)]
    low, high = (known.min(), known.max()) if known.size else (0.0, 1.0)
    scale = LinearScale.over(low, high)
    back = scale.values(scale.codes(values))
    assert (np.isnan(back) == np.isnan(values)).all()
    rounding = 1e-9 * max(1.0, abs(low), abs(high))
    assert np.nanmax(np.abs(back - values), initial=0.0) <= scale.quantum / 2 + rounding
    assert scale.quantum <= max(high - low, 1e-5) / (LINEAR_CODES - 1) + 1e-18 or high == low


def test_the_ends_of_a_range_are_the_first_and_the_last_code():
    assert LinearScale.over(-2.0, 5.0).codes(np.array([-2.0, 5.0, np.nan])).tolist() == [1, 65535, 0]
    assert LogScale.over(1e-5, 2e-3).codes(np.array([1e-5, 2e-3, np.nan, 0.0])).tolist() == [1, 255, 0, 0]


@pytest.mark.parametrize("ratio", [1.0, 1.5, 30.0, 1e4])
def test_a_deviation_differs_by_at_most_the_stated_share(ratio):
    sigmas = np.geomspace(3e-6, 3e-6 * ratio, 5000)
    scale = LogScale.over(sigmas[0], sigmas[-1])
    back = scale.values(scale.codes(sigmas))
    assert (np.abs(back / sigmas - 1) <= scale.error * (1 + 1e-6)).all()
    assert scale.error <= ratio ** (1 / 508) - 1 + 1e-8


@given(
    st.one_of(
        arrays(np.uint16, array_shapes(min_dims=2, max_dims=3, max_side=6)),
        arrays(np.uint8, array_shapes(min_dims=2, max_dims=2, max_side=6)),
    )
)
def test_packing_loses_nothing(codes):
    back = unpacked(packed(codes), codes.shape)
    assert back.dtype == codes.dtype
    assert (back == codes).all()


def test_a_smooth_field_is_small_and_noise_costs_its_bits():
    row, col = np.mgrid[0:200, 0:250]
    smooth = (30000 + 80 * row + 60 * col).astype(np.uint16)
    noise = np.random.default_rng(3).integers(0, 16, smooth.shape).astype(np.uint16)
    assert len(packed(smooth)) < 0.02 * smooth.nbytes
    assert len(packed(smooth + noise)) < 0.35 * smooth.nbytes  # 5 of 16 bits and the table of symbols


def test_equal_numbers_have_one_name_and_others_another():
    codes = np.arange(12, dtype=np.uint16).reshape(3, 4)
    assert blob_name(packed(codes)) == blob_name(packed(codes.copy()))
    assert blob_name(packed(codes)) != blob_name(packed(codes + 1))


def test_a_blob_is_a_raw_deflate_stream_of_low_bytes_then_high_bytes():
    codes = np.array([[258, 259], [513, 0]], np.uint16)  # differences 258, 1; 255, −513
    assert zlib.decompress(packed(codes), -15) == bytes([2, 1, 255, 255, 1, 0, 0, 253])
