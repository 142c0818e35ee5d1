"""Figures of maps and of arrays: valid, of the right size, and without overlaps."""

from __future__ import annotations

import numpy as np
import pytest
from map_images import colour_of, is_whole, opened

from dicflow.engine.product import Product, Variable
from dicflow.views import maps as views
from dicflow.views.colours import look
from dicflow.views.windows import MapWindow

pytestmark = pytest.mark.slow

LOOK = look("eyy", "strain along y", "1", 0.0, 0.4, "viridis")


def total(stretch):
    """A strip of 20 mm by 40 mm, stretched along y."""
    y, x = np.mgrid[0.0:40.0:41j, -10.0:10.0:11j]
    xyz = np.stack([x, y * stretch, np.full_like(x, 400.0)], axis=-1)
    return Product(
        "total",
        {
            "eyy": Variable(("row", "col"), np.full_like(x, stretch - 1.0), "1"),
            "xyz": Variable(("row", "col", "component"), xyz, "mm"),
        },
    )


@pytest.mark.parametrize("extent", [(0, 0, 100, 20), (0, 0, 10, 300), (0, 0, 300, 10)])
def test_maps_of_any_shape_are_whole_and_nothing_overlaps(extent):
    figure = views.field_map(total(1.2), LOOK, MapWindow(extent, "mm", "xyz"), "step_01 · loading")
    figure.draw_without_rendering()
    axes, bar = figure.axes
    for part in (axes.bbox, axes.xaxis.label.get_window_extent(), axes.title.get_window_extent()):
        assert not part.overlaps(bar.get_tightbbox())
    assert is_whole(opened(views.png(figure)))


def test_colours_show_the_value_and_equal_input_gives_equal_bytes():
    window = MapWindow((-13.0, -3.0, 13.0, 83.0), "mm", "xyz")
    once, twice, other = (views.png(views.field_map(total(x), LOOK, window, "a")) for x in (1.2, 1.2, 1.4))
    assert once == twice
    assert once != other
    assert colour_of(opened(once), 0.5) > 0.02
    assert colour_of(opened(other), 0.5) < 0.01
    assert "Software" not in opened(once).info


@pytest.mark.parametrize(("shape", "units"), [((30, 40), "grey level"), ((40, 30), "mm"), ((4, 400), "1")])
def test_a_picture_of_any_array(shape, units):
    values = np.arange(np.prod(shape)).reshape(shape) % 251
    variable = Variable(("row", "col"), values.astype(np.uint8 if units == "grey level" else float), units, "something")
    image = opened(views.png(views.picture(variable, "pair · left")))
    assert image.format == "PNG"
    assert is_whole(image)
    assert min(image.size) > 80
    coloured = np.ptp(np.asarray(image.convert("RGB"), int), axis=-1).max() > 20
    assert coloured == (units != "grey level")


def test_a_picture_of_codes_names_those_that_occur():
    codes = np.zeros((30, 10), np.uint8)
    codes[:10], codes[0, 0] = 7, 200
    names = {0: "valid", 2: "outside", 7: "background"}
    figure = views.code_picture(Variable(("row", "col"), codes), "total · status", names)
    _, bar = figure.axes
    assert [label.get_text() for label in bar.get_yticklabels()] == ["valid", "background", "200"]
    image = opened(views.png(figure))
    assert is_whole(image)
    assert colour_of(image, 0.0) / colour_of(image, 0.5) == pytest.approx(2, rel=0.2)
