"""Maps, contact sheets, animations and pictures of arrays: valid, of the right size, and equal for equal input."""

from __future__ import annotations

from io import BytesIO
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image

from dicflow.engine.product import Product, Variable
from dicflow.kinds.maps import Maps
from dicflow.views import maps as views

pytestmark = pytest.mark.slow

ROWS, COLS = 41, 11
MAPS = {
    "quantities": {
        "eyy": {"range": [0.0, 0.4], "unit": "1", "title": "strain along y"},
        "V": {"range": [0.0, 16.0], "unit": "mm", "title": "displacement along y"},
    },
    "positions": "xyz",
    "extent": [-10.0, 0.0, 10.0, 80.0],
    "unit": "mm",
    "colour_map": "viridis",
    "phases": ["loading", "loading"],
}


def shared(changes=None):
    """What the maps share, with some attributes changed."""
    return Maps.read(Product("maps", attrs=MAPS | (changes or {})))


def style(quantity, changes=None):
    """Look and window of a map."""
    maps = shared(changes)
    return views.map_look(maps, quantity), views.map_window(maps)


def total(stretch, hole=False):
    """A strip of 20 mm by 40 mm, stretched along y; a hole in its middle if asked."""
    y, x = np.mgrid[0.0 : 40.0 : ROWS * 1j, -10.0 : 10.0 : COLS * 1j]
    xyz = np.stack([x, y * stretch, np.full_like(x, 400.0)], axis=-1)
    eyy = np.full_like(x, stretch - 1.0)
    if hole:
        eyy[10:20, 3:8], xyz[10:20, 3:8] = np.nan, np.nan
    arrays = {"eyy": eyy, "V": y * (stretch - 1.0)}
    return Product(
        "total",
        {
            **{name: Variable(("row", "col"), values, "mm") for name, values in arrays.items()},
            "xyz": Variable(("row", "col", "component"), xyz, "mm"),
        },
    )


def opened(content):
    image = Image.open(BytesIO(content))
    image.load()
    return image


def drawn(product, quantity="eyy"):
    return views.png(views.field_map(product, *style(quantity), "step_01 · loading"))


def colour_of(image, colour):
    """Share of the pixels near a colour of the map, given by its place from 0 to 1."""
    import matplotlib

    expected = 255 * np.array(matplotlib.colormaps["viridis"](colour)[:3])
    return (np.abs(np.asarray(image.convert("RGB"), float) - expected).max(axis=-1) < 6).mean()


def is_whole(image):
    """Whether nothing reaches the picture's edge, and so nothing is cut off."""
    grey = np.asarray(image.convert("L"))
    return min(edge.min() for edge in (grey[:4], grey[-4:], grey[:, :4], grey[:, -4:])) == 255


def test_a_map_is_a_png_of_its_size():
    image = opened(drawn(total(1.2)))
    assert image.format == "PNG"
    _, window = style("eyy")
    x0, y0, x1, y1 = window.extent
    width_mm, height_mm = x1 - x0, y1 - y0
    map_px = 5.0 * 110 * np.array([width_mm / height_mm, 1.0])
    assert (map_px < image.size).all()
    assert (image.size < map_px + 1.8 * 110).all()
    assert is_whole(image)
    assert "Software" not in image.info


@pytest.mark.parametrize("extent", [(0, 0, 100, 20), (0, 0, 10, 300), (0, 0, 300, 10)])
def test_maps_of_any_shape_are_whole_and_nothing_overlaps(extent):
    figure = views.field_map(total(1.2), *style("eyy", {"extent": extent}), "step_01 · loading")
    figure.draw_without_rendering()
    axes, bar = figure.axes
    for part in (axes.bbox, axes.xaxis.label.get_window_extent(), axes.title.get_window_extent()):
        assert not part.overlaps(bar.get_tightbbox())
    assert is_whole(opened(views.png(figure)))


def test_equal_input_gives_equal_bytes():
    assert drawn(total(1.2)) == drawn(total(1.2))
    assert drawn(total(1.2)) != drawn(total(1.3))


def test_colours_show_the_value_within_one_range():
    """A strain in the middle of the range shows the middle of the map, the largest its end."""
    assert colour_of(opened(drawn(total(1.2))), 0.5) > 0.02
    assert colour_of(opened(drawn(total(1.4))), 1.0) > 0.02
    assert colour_of(opened(drawn(total(1.4))), 0.5) < 0.01


def test_the_strip_is_drawn_in_its_proportion():
    """Twice as long along y and as wide along x, the same colour fills twice the area."""
    long = total(2.0)
    long.variables["eyy"].values[:] = 0.0
    once, twice = (colour_of(opened(drawn(product)), 0.0) for product in (total(1.0), long))
    assert twice / once == pytest.approx(2.0, rel=0.1)


def test_where_nothing_is_known_nothing_is_drawn():
    whole, holed = (colour_of(opened(drawn(total(1.2, hole))), 0.5) for hole in (False, True))
    cells, lost = (ROWS - 1) * (COLS - 1), 11 * 6
    assert holed / whole == pytest.approx(1 - lost / cells, abs=0.06)


def test_maps_of_many_steps_have_one_layout():
    look, window = style("V")
    steps = [total(s) for s in (1.1, 1.2, 1.3)]
    frames = list(views.field_pngs(iter(steps), look, window, ["a", "b", "c"]))
    assert {opened(frame).size for frame in frames} == {opened(frames[0]).size}
    assert len(set(frames)) == 3
    assert frames == list(views.field_pngs(iter(steps), look, window, ["a", "b", "c"]))


def test_titles_of_all_steps_fit():
    frames = views.field_pngs([total(1.1)] * 3, *style("V"), ["a", "a long name " * 5, "a name " * 4])
    assert all(is_whole(opened(frame)) for frame in frames)


def test_an_animation_has_a_frame_per_step_and_repeats():
    look, window = style("eyy")
    frames = list(views.field_pngs((total(s) for s in (1.1, 1.2, 1.3)), look, window, "abc"))
    content = views.gif(frames, seconds=0.25)
    image = Image.open(BytesIO(content))
    assert (image.format, image.n_frames, image.size) == ("GIF", 3, opened(frames[0]).size)
    assert image.info["duration"] == 250
    assert image.info["loop"] == 0
    assert content == views.gif(frames, seconds=0.25)


def test_an_animation_has_the_colours_of_the_maps():
    """Also those that only its other frames have in plenty."""
    frames = list(views.field_pngs([total(1.4), total(1.0)], *style("eyy"), "ab"))
    animation = Image.open(BytesIO(views.gif(frames)))
    for place, frame in enumerate(frames):
        animation.seek(place)
        shown, meant = (np.asarray(image.convert("RGB"), int) for image in (animation, opened(frame)))
        assert np.abs(shown - meant).max() <= 6


@pytest.mark.parametrize(("count", "columns"), [(1, 1), (3, 3), (20, 15)])
def test_a_sheet_holds_all_steps_in_rows(count, columns):
    look, window = style("eyy")
    figure = views.contact_sheet([total(1.2)] * count, [f"{k}" for k in range(count)], look, window, "strain, loading")
    tiles = [axes.get_position() for axes in figure.axes[:-1]]
    assert len(tiles) == count
    assert len({round(tile.x0, 6) for tile in tiles}) == columns
    assert len({round(tile.y0, 6) for tile in tiles}) == -(-count // columns)
    image = opened(views.png(figure))
    assert image.format == "PNG"
    assert is_whole(image)
    below = [axes.get_xlabel() for axes in figure.axes[:count]]
    assert below == [""] * (count - columns) + ["X [mm]"] * columns
    assert [axes.get_ylabel() for axes in figure.axes[:count]].count("Y [mm]") == -(-count // columns)


def test_a_long_measure_stays_beside_its_bar_and_below_the_title():
    measure = {
        **MAPS["quantities"]["eyy"],
        "title": "engineering strain (material directions) εyy, VSG 61 px = 10.5 mm",
    }
    look, window = style("eyy", {"quantities": {"eyy": measure}})
    sheet = views.contact_sheet([total(1.2)] * 3, "abc", look, window, f"{look.title}, loading")
    alone = views.field_map(total(1.2), look, window, "a")
    for figure in (alone, sheet):
        figure.draw_without_rendering()
        bar = figure.axes[-1]
        label = bar.yaxis.label.get_window_extent()
        assert bar.bbox.y0 <= label.y0 < label.y1 <= bar.bbox.y1
    assert not label.overlaps(sheet.texts[0].get_window_extent())


def test_long_names_on_a_sheet_keep_apart():
    names = [f"specimen 12, photograph {k:04d}" for k in range(4)]
    figure = views.contact_sheet([total(1.2)] * 4, names, *style("eyy"), "strain, loading")
    titles = [axes.title.get_window_extent() for axes in figure.axes[:4]]
    assert all(one.x1 < other.x0 for one, other in pairwise(titles))


def test_labels_name_measure_and_unit():
    assert style("V")[0].label == "displacement along y [mm]"
    assert style("eyy")[0].label == "strain along y [–]"


def test_values_of_both_signs_have_zero_in_the_middle_of_the_colours():
    signed = {"range": [-0.1, 0.4], "unit": "1", "title": "strain along y"}
    chosen, _ = style("eyy", {"quantities": {"eyy": signed}, "colour_map": "auto"})
    assert (chosen.range, chosen.table) == ((-0.4, 0.4), "RdBu_r")
    assert style("V", {"colour_map": "auto"})[0].table == "viridis"


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
