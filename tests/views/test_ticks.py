"""Round numbers along an axis: multiples of 1, 2 or 5 times a power of ten, all inside, each where its value lies."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dicflow.views.ticks import ticks_that_fit


def values(found):
    """The numbers that the texts say."""
    raised = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")
    power = int(found.factor.removeprefix("×10").translate(raised)) if found.factor else 0
    return [float(text.translate(raised)) * 10.0**power for text in found.texts]


@pytest.mark.parametrize(
    ("low", "high"), [(0, 1), (-14, 14), (0.06, 1.27), (-2.3e-5, 1.7e-5), (1e5, 3e5), (999.2, 1000.1), (-0.31, -0.07)]
)
def test_numbers_stand_where_their_values_lie(low, high):
    found = ticks_that_fit(low, high, lambda share, texts: True)
    assert 4 <= len(found.texts) <= 10
    np.testing.assert_allclose(
        values(found), low + np.array(found.shares) * (high - low), rtol=0, atol=1e-3 * (high - low)
    )
    assert all(0 <= share <= 1 for share in found.shares)
    step = values(found)[1] - values(found)[0]
    assert round(step / 10 ** math.floor(math.log10(step) + 1e-6), 3) in (1.0, 2.0, 5.0)


def test_numbers_are_as_close_as_their_texts_allow():
    def fits(share, texts):
        asked.append(share)
        return share * 100 >= 30

    asked = []
    found = ticks_that_fit(0.0, 10.0, fits)
    assert found.texts == ("0", "5", "10")
    assert asked == pytest.approx([0.2, 0.5])
    assert len(ticks_that_fit(0.3, 0.9, lambda share, texts: False).texts) < 2


def test_small_and_large_numbers_share_a_factor():
    found = ticks_that_fit(0.0, 2e-5, lambda share, texts: share >= 0.5)
    assert found == (pytest.approx((0.0, 0.5, 1.0)), ("0", "1", "2"), "×10⁻⁵")
    assert ticks_that_fit(-3e6, 0.0, lambda share, texts: True).texts[:2] == ("−3.0", "−2.5")
    assert ticks_that_fit(0.0, 2e-3, lambda share, texts: True).factor == ""
