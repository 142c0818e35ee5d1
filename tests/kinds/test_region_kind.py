import numpy as np

from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import rectangle
from dicflow.kinds.region import Region
from tests.kinds.layouts import stored

OUTER, HOLE = rectangle(10, 20, 110, 70).exterior, rectangle(30, 30, 50, 40).exterior


def test_outlines_come_back_with_their_holes_and_area():
    product = stored(Region.write([Polygon(OUTER, (HOLE,))]))
    region = Region.read(product)
    (part,) = region.polygons
    np.testing.assert_array_equal(part.exterior, OUTER)
    np.testing.assert_array_equal(part.holes[0], HOLE)
    assert region.area_px == 100 * 50 - 20 * 10
    assert region.summary == {"area_px": region.area_px}
    assert product.variables == {}


def test_corners_are_kept_to_a_thousandth_of_a_pixel():
    (part,) = Region.read(stored(Region.write([Polygon(OUTER + 1 / 3)]))).polygons
    np.testing.assert_allclose(part.exterior, OUTER + 1 / 3, atol=5e-4)
    assert (part.exterior != OUTER + 1 / 3).any()
