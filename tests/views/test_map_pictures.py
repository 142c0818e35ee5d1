"""Maps and contact sheets as pixels: whole, true to scale and colour, without overlaps, equal for equal input."""

from __future__ import annotations

from io import BytesIO
from itertools import combinations

import numpy as np
import pytest
from map_images import colour_of, is_whole, opened
from PIL import Image

from dicflow.engine.product import Product, Variable
from dicflow.kinds.maps import Maps
from dicflow.views import lettering, sheets
from dicflow.views import map_pictures as views
from dicflow.views.levels import COLOURS, gif_file, png_file
from dicflow.views.sheets import sheet
from dicflow.views.windows import map_look, map_window

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
LONG = "engineering strain (material directions) εyy, VSG 61 px = 10.5 mm"


def style(quantity="eyy", **changes):
    """Look and window of a map, with some attributes of the maps changed."""
    maps = Maps.read(Product("maps", attrs=MAPS | changes))
    return map_look(maps, quantity), map_window(maps)


def titled(title):
    return {"eyy": {**MAPS["quantities"]["eyy"], "title": title}}


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


def drawn(product, *, title="step_01 · loading", **changes):
    return views.map_png(product, *style(**changes), title)


def frames(quantity, *stretches):
    look, window = style(quantity)
    titles = [str(stretch) for stretch in stretches]
    page = views.map_sheet(look, window, titles)
    return page, list(views.maps_of_steps(page, (total(stretch) for stretch in stretches), look, window, titles))


@pytest.fixture
def texts(monkeypatch):
    """Each text that is written on a page, with its box on it: x0, y0, x1, y1."""
    found = []
    write, upright, put_name = lettering.Paper.text, lettering.Paper.upright, sheets.Sheet._put_name

    def text(paper, x, y, line, size_px, anchor="mm"):
        if paper.image.width > 100 and paper.image.height > 100:
            found.append((line, paper._draw.textbbox((x, y), line, lettering._font(size_px), anchor)))
        write(paper, x, y, line, size_px, anchor)

    def turned(paper, x, y, line, size_px):
        half = lettering.text_width(line, size_px) / 2
        found.append((line, (x - size_px / 2, y - half, x + size_px / 2, y + half)))
        upright(paper, x, y, line, size_px)

    def named(page, picture, corner, name):
        width, height = lettering.text_width(name, page.name_px), lettering.line_height(page.name_px)
        x, y = corner[0] + (page.tile[0] - width) / 2, corner[1] - sheets._PAD - height
        found.append((name, (x, y, x + width, y + height)))
        put_name(page, picture, corner, name)

    monkeypatch.setattr(sheets.Sheet, "_put_name", named)
    monkeypatch.setattr(lettering.Paper, "text", text)
    monkeypatch.setattr(lettering.Paper, "upright", turned)
    return found


def overlap(one, other):
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def test_a_map_is_a_png_of_its_size():
    image = opened(drawn(total(1.2)))
    assert image.format == "PNG"
    _, window = style()
    assert views.map_tile(window) == (round(550 * window.aspect), 550)
    assert image.height < 550 + 110
    assert is_whole(image)
    assert image.info == {}


@pytest.mark.parametrize("extent", [(0, 0, 100, 20), (0, 0, 10, 300), (0, 0, 300, 10), (-1e-4, 0, 1e-4, 3e-4)])
@pytest.mark.parametrize("title", ["σ of εyy", LONG])
def test_maps_of_any_shape_are_whole_and_no_two_texts_overlap(extent, title, texts):
    values = {"eyy": {"range": [-2.1e-5, 1.3e-5], "unit": "1", "title": title}}
    image = opened(drawn(total(1.2), extent=extent, quantities=values))
    assert is_whole(image)
    assert len(texts) > 5
    for (one, box), (other, other_box) in combinations(texts, 2):
        assert not overlap(box, other_box), (one, other)


def test_equal_input_gives_equal_bytes():
    assert drawn(total(1.2)) == drawn(total(1.2))
    assert drawn(total(1.2)) != drawn(total(1.3))


def test_colours_show_the_value_within_one_range():
    """A strain in the middle of the range shows the middle of the map, the largest its end."""
    assert colour_of(opened(drawn(total(1.2))), 0.5) > 0.02
    assert colour_of(opened(drawn(total(1.4))), 1.0) > 0.02
    assert colour_of(opened(drawn(total(1.4))), 0.5) < 0.01


def test_the_strip_is_where_its_places_are():
    """20 mm of 26.4 mm wide and 40 mm · 1.5 of 86.4 mm long, in a window with a margin of 3.2 mm on each side."""
    look, window = style()
    levels = views.map_levels(total(1.5), look, window)
    rows, columns = np.nonzero(levels < COLOURS)
    height, width = levels.shape
    x0, x1 = columns.min() / width * 26.4 - 13.2, (columns.max() + 1) / width * 26.4 - 13.2
    y0, y1 = rows.min() / height * 86.4 - 3.2, (rows.max() + 1) / height * 86.4 - 3.2
    np.testing.assert_allclose([x0, x1, y0, y1], [-10, 10, 0, 60], atol=26.4 / width)


def test_where_nothing_is_known_nothing_is_drawn():
    look, window = style()
    whole, holed = ((views.map_levels(total(1.2, hole), look, window) < COLOURS).mean() for hole in (False, True))
    cells, lost = (ROWS - 1) * (COLS - 1), 11 * 6
    assert holed / whole == pytest.approx(1 - lost / cells, abs=0.02)


def test_maps_of_many_steps_have_one_layout():
    page, pictures = frames("V", 1.1, 1.2, 1.3)
    assert {picture.shape for picture in pictures} == {page.ground.shape}
    inside = np.zeros(page.ground.shape, bool)
    page.map_in(inside)[:] = True
    inside[: page.corners[0][1]] = True
    for one, other in combinations(pictures, 2):
        assert (one != other).any()
        np.testing.assert_array_equal(one[~inside], other[~inside])


def test_titles_of_all_steps_fit():
    look, window = style("V")
    titles = ["a", "a long name " * 5, "a name " * 4]
    page = views.map_sheet(look, window, titles)
    for picture in views.maps_of_steps(page, [total(1.1)] * 3, look, window, titles):
        assert is_whole(opened(png_file(picture, page.colours)))


def test_an_animation_has_a_frame_per_step_and_repeats():
    page, pictures = frames("eyy", 1.1, 1.2, 1.3)
    content = gif_file(iter(pictures), page.colours, seconds=0.25)
    image = Image.open(BytesIO(content))
    assert (image.format, image.n_frames, image.size) == ("GIF", 3, page.size)
    assert image.info["duration"] == 250
    assert image.info["loop"] == 0
    assert content == gif_file(pictures, page.colours, seconds=0.25)


def test_an_animation_has_the_colours_of_the_maps():
    page, pictures = frames("eyy", 1.4, 1.0)
    animation = Image.open(BytesIO(gif_file(pictures, page.colours)))
    for place, picture in enumerate(pictures):
        animation.seek(place)
        np.testing.assert_array_equal(np.asarray(animation.convert("RGB")), page.colours[picture])


def small_maps(count, **changes):
    look, window = style(**changes)
    return [views.map_levels(total(1.2), look, window)] * count, look, window


@pytest.mark.parametrize(("count", "columns"), [(1, 1), (3, 3), (20, 15)])
def test_a_sheet_holds_all_steps_in_rows(count, columns, texts):
    maps, look, window = small_maps(count)
    image = opened(views.contact_sheet(maps, [str(k) for k in range(count)], look, window, "strain, loading"))
    assert image.format == "PNG"
    assert is_whole(image)
    written = [text for text, _box in texts]
    assert written.count("X [mm]") == columns
    assert written.count("Y [mm]") == -(-count // columns)
    strips = np.asarray(image.convert("RGB"), int)
    middle = np.abs(strips - opened(drawn(total(1.2))).convert("RGB").getpixel((120, 200))).max(axis=-1) < 3
    assert middle.mean() * image.width * image.height > 0.8 * count * (240 * 0.3 * 20 / 86.4 * 48)


def test_a_long_measure_stays_beside_its_bar_and_the_title_above_all(texts):
    maps, look, window = small_maps(3, quantities=titled(LONG))
    image = opened(views.contact_sheet(maps, "abc", look, window, f"{look.title}, loading"))
    assert is_whole(image)
    for (one, box), (other, other_box) in combinations(texts, 2):
        assert not overlap(box, other_box), (one, other)
    lines = [text for text, _box in texts if text.endswith("[–]")]
    assert lines
    assert all("mm\N{NO-BREAK SPACE}[–]" in line for line in lines)


def test_long_names_on_a_sheet_keep_apart():
    look, window = style()
    names = [f"specimen 12, photograph {k:04d}" for k in range(4)]
    page = sheet(window, look, (60, 240), names, columns=4)
    widths = [lettering.text_width(name, page.name_px) for name in names]
    middles = [x + 30 for x, _y in page.corners]
    assert all(right - left > width for left, right, width in zip(middles, middles[1:], widths, strict=False))
    assert middles[0] > widths[0] / 2


def test_labels_name_measure_and_unit():
    assert style("V")[0].label == "displacement along y [mm]"
    assert style("eyy")[0].label == "strain along y [–]"


def test_values_of_both_signs_have_zero_in_the_middle_of_the_colours():
    signed = {"eyy": {"range": [-0.1, 0.4], "unit": "1", "title": "strain along y"}}
    chosen, _ = style("eyy", quantities=signed, colour_map="auto")
    assert (chosen.range, chosen.table) == ((-0.4, 0.4), "RdBu_r")
    assert style("V", colour_map="auto")[0].table == "viridis"


@pytest.mark.parametrize("extent", [(0, 0, 20, 80), (0, 0, 100, 20)])
def test_the_bar_runs_through_all_colours_and_its_numbers_stand_at_their_values(extent, texts):
    """Upright beside the maps or level below them."""
    look, window = style(extent=extent)
    page = views.map_sheet(look, window, ["a"])
    bar = [np.flatnonzero((page.ground < COLOURS).any(axis=axis)) for axis in (0, 1)]
    (x0, x1), (y0, y1) = ((along[0], along[-1]) for along in bar)
    upright = y1 - y0 > x1 - x0
    line = page.ground[y1 : y0 - 1 : -1, x0] if upright else page.ground[y0, x0 : x1 + 1]
    assert line[0] == 0
    assert line[-1] == COLOURS - 1
    assert (np.diff(line.astype(int)) >= 0).all()
    numbers = {text: box for text, box in texts if text.startswith("0.")}
    assert len(numbers) >= 5
    for text, (left, top, right, bottom) in numbers.items():
        middle = (top + bottom) / 2 if upright else (left + right) / 2
        place = y1 - float(text) / 0.4 * (y1 - y0) if upright else x0 + float(text) / 0.4 * (x1 - x0)
        assert middle == pytest.approx(place, abs=3)
