"""The page of two measurements compared, and the command that writes it."""

from html.parser import HTMLParser

import numpy as np
import pytest
from small import dicflow

from dicflow.comparison.difference import Comparison, Difference
from dicflow.core.uncertainty.agreement import agreement
from dicflow.engine.keys import Change
from dicflow.report.difference import COLUMNS, difference, difference_page, difference_rows
from dicflow.views.difference import difference_maps
from dicflow.views.maps import png

pytestmark = pytest.mark.slow


def one(step="step_01", quantity="eyy", unit="1", offset=0.0):
    places = np.stack(np.meshgrid(np.arange(0.0, 40, 5), np.arange(0.0, 30, 5)), axis=-1)
    values = np.where(places[..., 0] > 20, np.nan, 1e-3 * places[..., 1] + offset)
    return Difference(step, quantity, "strain <b>", unit, places, values, agreement(values))


def comparison(*differences, changes=()):
    return Comparison("a.yaml", "b <i>.csv", changes, differences, ("Beware & look.",))


class Balanced(HTMLParser):
    """Every tag that opens closes; what is fetched is written in the page."""

    def __init__(self, text):
        super().__init__()
        self.open = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "br", "img", "input", "link", "hr"):
            self.open.append(tag)
        assert dict(attrs).get("src", "data:").startswith("data:")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_page_is_whole_and_escaped():
    changes = (Change("parameter", "surface.robust", "LAR", "<none>"),)
    page = difference_page(comparison(one(), one("step_02"), one(quantity="U", unit="mm"), changes=changes)).decode()
    Balanced(page)
    assert "surface.robust: LAR → &lt;none&gt;" in page
    assert "b &lt;i&gt;.csv" in page
    assert "strain <b>" not in page
    assert page.count("data:image/png") == 2


def test_section_says_that_nothing_differs():
    zero = one()._replace(values=np.zeros((2, 2)), places=np.zeros((2, 2, 2)), agreement=agreement(np.zeros((2, 2))))
    section = difference(comparison(zero))
    assert "No difference." in section.body
    assert "All equal." in section.body
    assert section.warnings == ("Beware & look.",)
    assert "No difference." not in difference(comparison(one())).body
    assert "Settings" not in difference(comparison(one(), changes=None)).body


def test_rows_are_the_statistics():
    found = one(offset=0.5)
    (row,) = difference_rows(comparison(found))
    named = dict(zip(COLUMNS, row, strict=True))
    assert named["points"] == 30
    assert named["share %"] == pytest.approx(62.5)
    assert named["mean"] == pytest.approx(0.5125)
    assert named["unit"] == "–"
    assert named["outside σ %"] == "–"


def test_maps_share_one_range_about_zero_and_equal_inputs_give_equal_bytes():
    steps = [one(f"step_{index}", offset=0.01 * index) for index in range(4)]
    figure = difference_maps(steps)
    drawn = [axes.collections[0] for axes in figure.axes if axes.get_xlabel() == "x [px]"]
    assert len(drawn) == 4
    low, high = drawn[0].get_clim()
    assert low == -high
    assert all(points.get_clim() == (low, high) for points in drawn)
    assert len(drawn[0].get_offsets()) == 30
    assert figure.axes[-1].get_ylabel() == "eyy: A − B [–]"
    assert png(difference_maps(steps)) == png(difference_maps(steps))


def test_nothing_known_is_an_empty_map():
    empty = one()._replace(values=np.full((6, 8), np.nan))
    (axes, *_) = difference_maps([empty]).axes
    assert len(axes.collections[0].get_offsets()) == 0


def test_command(pipeline, measured, tmp_path):
    page = tmp_path / "difference.html"
    answer = dicflow("compare", pipeline, f"{pipeline}#1", "--step", "step_01", "--quantity", "U", "--output", page)
    assert answer.code == 0, answer.err
    assert "no difference" in answer.out
    assert "step_01" in answer.out
    Balanced(page.read_text())
    assert str(pipeline.parent) not in page.read_text()
    before = page.read_bytes()
    dicflow("compare", pipeline, pipeline, "--output", page).refuses(2, "difference.html", "--force")
    dicflow("compare", pipeline, pipeline, "--output", page.with_suffix(".txt")).refuses(2, "is written as .html")
    assert not page.with_suffix(".txt").exists()
    assert page.read_bytes() == before
    line = dicflow("compare", pipeline, pipeline, "--json").line
    assert line["differs"] is False
    assert {found["step"] for found in line["differences"]} == {"step_01", "step_02"}
    dicflow("compare", pipeline, pipeline, "--quantity", "ezz").refuses(2, "'ezz'", "eyy")
    dicflow("compare", pipeline, "20200101-000000-abcdef").refuses(2, "20200101-000000-abcdef", "lists all runs")
