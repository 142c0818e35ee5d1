"""The verdict on a result in one line."""

import pytest

from dicflow.report.answer import verdict


def manifest(*shares):
    """A manifest with what the verdict reads: the valid share of each step, None for one that was not measured."""
    quantity = {"name": "exx", "symbol": "εxx", "unit": "1", "means": [(0.01, 0.001) for _ in shares]}
    steps = [{"name": f"step_{number}", "valid": share} for number, share in enumerate(shares)]
    return {"main": ("exx", 0), "quantities": [quantity], "form": "deformation", "steps": steps}


@pytest.mark.parametrize(
    ("shares", "words", "head"),
    [
        ((1.0, 1.0), "2 of 2 steps measured, all points have a value.", "Measured"),
        ((1.0,), "the surface measured, all points have a value.", "Measured"),
        ((1.0, 0.99999), "at least 99.9 % of the points have a value.", "Measured"),
        ((0.95,), "95.0 % of the points have a value.", "Measured"),
        ((1.0, 0.5), "at least 50.0 % of the points have a value.", "Measured, with gaps"),
        ((1.0, None), "1 of 2 steps measured, all points have a value.", "Incomplete"),
    ],
)
def test_the_share_of_points_is_never_rounded_up(shares, words, head):
    found = verdict(manifest(*shares), warnings=0, failures=0)
    assert found.text.endswith(words)
    assert found.head == head


def test_warnings_are_counted():
    assert verdict(manifest(1.0), 2, 0).text.endswith("all points have a value. 2 warnings are below.")
