"""The verdict on a result in one line."""

import pytest

from dicflow.report.answer import Seen, verdict

QUANTITY = {"name": "exx", "symbol": "εxx", "unit": "1", "means": [(0.01, 0.001)]}
MANIFEST = {"main": ("exx", 0), "quantities": [QUANTITY], "form": "deformation", "steps": [{"name": "step_0"}]}


@pytest.mark.parametrize(
    ("seen", "words", "head"),
    [
        ((2, 2, 1.0), "2 of 2 steps measured, all points have a value.", "Measured"),
        ((1, 1, 1.0), "the surface measured, all points have a value.", "Measured"),
        ((2, 2, 0.99999), "at least 99.9 % of the points have a value.", "Measured"),
        ((1, 1, 0.95), "95.0 % of the points have a value.", "Measured"),
        ((2, 2, 0.5), "at least 50.0 % of the points have a value.", "Measured, with gaps"),
        ((2, 1, 1.0), "1 of 2 steps measured, all points have a value.", "Incomplete"),
    ],
)
def test_the_share_of_points_is_never_rounded_up(seen, words, head):
    found = verdict(MANIFEST, Seen(*seen), warnings=0, failures=0)
    assert found.text.endswith(words)
    assert found.head == head


def test_warnings_are_counted():
    assert verdict(MANIFEST, Seen(1, 1, 1.0), 2, 0).text.endswith("all points have a value. 2 warnings are below.")
