"""How certain the strains of a caliper are: by the step in which its lengths were read."""

from __future__ import annotations

import numpy as np
import pytest

from dicflow.comparison.caliper import caliper_uncertainty, reading_step


@pytest.mark.parametrize("step", [1.0, 0.5, 0.1, 0.05, 0.02, 0.01, 0.001])
def test_the_step_is_the_largest_that_fits(step):
    lengths = 60.0 + step * np.array([0.0, 7.0, 181.0, 402.0])
    assert reading_step(lengths) == step


def test_rounding_gives_the_scatter_that_is_stated():
    """Strains of lengths rounded to 0.05 mm, against those of the exact lengths."""
    rng = np.random.default_rng(1)
    first, later = rng.uniform(59.0, 61.0, 4000), rng.uniform(119.0, 123.0, 4000)
    rounded = [np.round(one / 0.05) * 0.05 for one in (first, later)]
    errors = rounded[1] / rounded[0] - later / first
    u = caliper_uncertainty(np.array([60.0, 121.05]))
    assert u[0] == 0.0
    assert errors.std() == pytest.approx(u[1], rel=0.05)
