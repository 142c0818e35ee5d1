"""Line charts: each mark where its value lies, gaps left open, texts apart, and fit to stand inside a page."""

from __future__ import annotations

import re
from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pytest

from dicflow.views.lettering import text_width
from dicflow.views.line_charts import Curve, chart_over_steps, chart_over_values

VALUES = np.array([0.0, 100.0, 200.0, 300.0, 250.0])


def curve(name="DIC", y=(0.0, 0.1, np.nan, 0.4, 0.3), square=False):
    hollow = np.array([False, False, False, True, True])
    return Curve(name, VALUES, np.array(y), hollow, square)


def loads():
    return chart_over_values([curve(), curve("caliper", np.linspace(0, 0.4, 5), True)], "load [g]", "strain [–]")


def steps(count=22, name="step_{:02d}"):
    values = np.random.default_rng(1).random(count)
    series = {"εxx": 1e-5 * values, "εyy": [None, *(3e-5 * values[1:])], "γxy": [None] * count}
    return chart_over_steps([name.format(number) for number in range(count)], series, "σ [–]")


CHARTS = [loads, steps, lambda: steps(3), lambda: steps(500), lambda: steps(12, "a very long name of photograph {}")]
every_chart = pytest.mark.parametrize("chart", CHARTS)


def texts(svg):
    """Each text with its box: x0, y0, x1, y1."""
    found = []
    for parent in ElementTree.fromstring(svg).iter():
        for text in parent.findall("text"):
            size = float(parent.get("font-size"))
            x, y, width = float(text.get("x")), float(text.get("y")), text_width(text.text, size)
            start = x - {"start": 0, "middle": width / 2, "end": width}[text.get("text-anchor", "middle")]
            box = (start, y - 0.75 * size, start + width, y + 0.2 * size)
            if "transform" in text.attrib:  # turned about (x, y), from right to up
                box = (x + box[1] - y, y - (box[2] - x), x + box[3] - y, y - (box[0] - x))
            found.append((text.text, box))
    return found


def marks(svg, tag, keys):
    return np.array([[float(one.get(key)) for key in keys] for one in ElementTree.fromstring(svg).iter(tag)])


@every_chart
def test_no_two_texts_overlap_and_none_is_cut(chart):
    svg = chart()
    width, height = map(float, re.search(r'viewBox="0 0 (\S+) (\S+)"', svg).groups())
    found = texts(svg)
    assert len(found) > 5
    for (one, a), (other, b) in combinations(found, 2):
        assert not (a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]), (one, other)
    for text, box in found:
        assert min(box[0], box[1], width - box[2], height - box[3]) >= -1, text


def test_marks_lie_at_their_values():
    """Places are linear in the values, by the numbers along both axes."""
    svg = loads()
    numbers = {text: box for text, box in texts(svg)}
    x = [(numbers[text][0] + numbers[text][2]) / 2 for text in ("0", "100", "300")]
    y = [(numbers[text][1] + numbers[text][3]) / 2 for text in ("0.0", "0.1", "0.4")]
    dots = marks(svg, "circle", ("cx", "cy"))
    np.testing.assert_allclose(dots[:3], np.stack([x, y], axis=-1), atol=1.5)
    squares = marks(svg, "rect", ("x", "y")) + 4
    np.testing.assert_allclose(squares[[0, 4]][:, 1], [y[0], y[2]], atol=1.5)
    assert [one.get("fill") for one in ElementTree.fromstring(svg).iter("circle")].count("none") == 2


def test_a_gap_breaks_the_line():
    lines = [one.get("d") for one in ElementTree.fromstring(loads()).iter("path") if one.get("stroke-opacity")]
    assert [re.sub(r"[^ML]", "", line) for line in lines] == ["MLML", "MLLLL"]


def test_a_chart_of_nothing_and_one_of_equal_numbers_are_drawn():
    assert "circle" not in chart_over_steps(["a", "b"], {"all": [None, None]}, "σ [px]")
    dots = marks(chart_over_steps(["a", "b"], {"all": [7.0, 7.0]}, "σ [px]"), "circle", ("cx", "cy"))
    assert dots[0, 1] == dots[1, 1]


def test_many_steps_are_named_by_some():
    names = [text for text, _box in texts(steps(500)) if text.startswith("step_")]
    assert 20 <= len(names) <= 40
    assert names[0] == "step_00"


@every_chart
def test_it_asks_for_nothing_takes_the_pages_colour_and_is_equal_for_equal_input(chart):
    svg = chart()
    assert svg == chart()
    assert "currentColor" in svg
    assert "http" not in svg
    assert "id=" not in svg


def test_names_are_text():
    svg = chart_over_steps(["<b>", "&"], {"<i>": [1.0, 2.0], '"': [2.0, 1.0]}, "<u> [px]")
    assert {"<b>", "&", "<i>", '"', "<u> [px]"} <= {text for text, _box in texts(svg)}


def test_bars_reach_as_far_as_the_values_say_and_have_room():
    """Both axes show 0 to 1.5 from the first mark, with a twentieth at each end; the second has bars of length 1."""
    half = np.array([0.0, 0.5])
    bars = Curve("a", np.array([1.0, 2.0]), np.array([0.0, 1.0]), np.zeros(2, bool), x_half=half, y_half=half)
    chart = chart_over_values([bars._replace(marked=False)], "x", "y")
    assert "<circle" not in chart
    width = float(re.search(r"V[\d.]+h([\d.]+)", chart)[1])
    found = [[float(v) for v in bar] for bar in re.findall(r"M([\d.]+) ([\d.]+)L([\d.]+) ([\d.]+)", chart)]
    (left, level, right, other), (across, low, same, high) = found[-2:]
    assert (level, across) == (other, same)
    assert right - left == pytest.approx(width / 1.65, abs=0.2)
    assert low - high == pytest.approx(190 / 1.65, abs=0.2)
    assert (left + right) / 2 == pytest.approx(across, abs=0.1)


def test_many_points_are_a_line_without_marks():
    few, many = (chart_over_steps([f"s{n}" for n in range(count)], {"a": [0.1] * count}, "a") for count in (200, 201))
    assert few.count("<circle") == 200
    assert "<circle" not in many
    assert many.count("L") >= 200


def test_the_key_shows_what_a_curve_is_drawn_with():
    alone, joined, many = (
        Curve(name, np.arange(count, dtype=float), np.arange(count, dtype=float), np.zeros(count, bool), joined=lines)
        for name, count, lines in (("marks", 3, False), ("both", 3, True), ("line", 300, True))
    )
    root = ElementTree.fromstring(chart_over_values([alone, joined, many], "load [g]", "strain [–]"))
    keys = {key.findtext("text"): {part.tag for part in key} - {"text"} for key in root.iter("g")}
    assert keys == {"marks": {"circle"}, "both": {"circle", "path"}, "line": {"path"}}
