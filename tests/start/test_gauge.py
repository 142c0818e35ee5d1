"""The extensometer along the load, over regions and motions that are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import contains, rectangle
from dicflow.core.synthetic.planar import planar_pair, translation
from dicflow.start.gauge import gauge_over

pytestmark = pytest.mark.slow

SIZE = (400, 300)
WHOLE = [rectangle(10, 10, 389, 289)]


def measured(polygons, *transforms):
    """The extensometer in a test whose steps are these motions of the first photograph."""
    pairs = [planar_pair(SIZE, transform, seed=4, noise=1.0) for transform in transforms]
    images = [pairs[0].reference, *(pair.deformed for pair in pairs)]
    files = [Path(str(k)) for k in range(len(images))]
    return gauge_over(polygons, files, lambda path: images[int(path.name)])


@pytest.mark.parametrize(
    ("stretch", "axis"),
    [((1.05, 0.98), "x"), ((0.985, 1.06), "y"), ((0.97, 1.01), "x"), ((1.01, 0.97), "y"), ((1.006, 0.998), "x")],
)
def test_the_strain_tells_the_axis_of_the_load(stretch, axis):
    """In tension and in compression, against the longer side too."""
    gauge = measured(WHOLE, np.diag([*stretch, 1.0]))
    assert gauge.axis == axis
    assert f"{100 * (stretch[0] - 1):+.1f} % along x" in gauge.reason


@pytest.mark.parametrize(("box", "axis"), [((10, 10, 389, 200), "x"), ((100, 10, 240, 289), "y")])
def test_without_strain_the_longer_side_does(box, axis):
    gauge = measured([rectangle(*box)], translation([6.3, -4.2]))
    assert (gauge.axis, "longer side" in gauge.reason) == (axis, True)


def test_a_step_that_does_not_match_is_passed_over():
    """As after the specimen broke."""
    turned = np.array([[-1.0, 0, 400], [0, -1.0, 300], [0, 0, 1]])
    still = np.diag([1.04, 0.98, 1.0])
    gauge = measured([rectangle(100, 10, 240, 289)], still, still, turned)
    assert gauge.axis == "x"
    assert gauge.reason.endswith("until step 3 of 4")


@pytest.mark.parametrize(
    "polygons",
    [
        WHOLE,
        [Polygon(WHOLE[0].exterior, (rectangle(120, 80, 280, 220).exterior,))],
        [Polygon(np.array([[60.0, 10], [340, 10], [250, 150], [340, 289], [60, 289], [150, 150]]))],
    ],
    ids=["whole", "with an opening", "waisted"],
)
@pytest.mark.parametrize("stretch", [(1.03, 0.99), (0.99, 1.03)])
def test_its_ends_lie_well_inside_on_one_line(polygons, stretch):
    gauge = measured(polygons, np.diag([*stretch, 1.0]))
    along = {"x": 0, "y": 1}[gauge.axis]
    (first, second) = np.array(gauge.ends, dtype=float)
    assert first[1 - along] == second[1 - along]
    assert second[along] - first[along] > 0.4 * np.ptp(polygons[0].exterior[:, along])
    around = 20.0 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    assert contains(polygons, gauge.ends + around[:, None]).all()


def test_a_narrow_region_has_none():
    assert measured([rectangle(10, 10, 389, 60)], np.diag([1.03, 0.99, 1.0])) is None
