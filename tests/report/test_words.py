import math

import pytest

from dicflow.report.words import date, duration, least_percent, number, percent


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (math.nan, "–"),
        (0.0, "0"),
        (12.3456, "12.35"),
        (-0.5, "−0.5000"),
        (123456.7, "123457"),
        (2.5123e-5, "2.51·10⁻⁵"),
        (-2.5e-11, "−2.50·10⁻¹¹"),
        (1e-3, "0.001000"),
    ],
)
def test_a_number_has_four_significant_digits(value, text):
    assert number(value) == text


def test_shares_and_times():
    assert (percent(0.9971), percent(None), percent(math.nan)) == ("99.7 %", "–", "–")
    assert [least_percent(one) for one in (1.0, 0.99999, 0.998, None)] == ["100.0 %", "99.9 %", "99.8 %", "–"]
    assert (duration(0.04), duration(99.94), duration(150), duration(7200)) == ("0.0 s", "99.9 s", "2.5 min", "2.0 h")
    assert date(86400.0 * 365) == "1971-01-01 00:00 UTC"
