"""Random hard scenes: what is called valid is right within its uncertainty, and good scenes lose nothing.

The bounds are those of the full run, ``python -m tests.hard_scenes``, with room for the few points of a short one.
"""

import numpy as np
import pytest

from tests.hard_photographs import KINDS, scene
from tests.hard_scenes import REPORTED, measured, shares

pytestmark = pytest.mark.slow

BEYOND_3, BEYOND_5 = 0.03, 0.005


def test_the_motion_of_a_scene_is_exact():
    """A point's place in the target leads back to the point, on both sides of a crack."""
    motion = scene("crack", REPORTED).motion
    points = np.stack(np.meshgrid(np.arange(30.0, 200.0, 7.0), np.arange(30.0, 170.0, 7.0)), axis=-1)
    back, in_gap = motion.material(motion.target(points))
    assert np.abs(back - points)[~in_gap].max() < 1e-9
    assert in_gap.mean() < 0.05


def test_good_scenes():
    found = shares(measured("good", REPORTED, 3))
    assert found.valid > 0.999
    assert found.beyond_3 < BEYOND_3
    assert found.beyond_5 == 0.0
    assert 0.7 < found.scatter < 1.4


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("good", "fine crack")])
def test_hard_scenes(kind):
    found = shares(measured(kind, REPORTED, 3))
    assert found.valid > 0.5
    assert found.beyond_3 < BEYOND_3
    assert found.beyond_5 < BEYOND_5
