"""Charts: whole, with units, without overlaps, equal for equal input, and fit to stand inside a page."""

from __future__ import annotations

import re
from io import BytesIO
from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from dicflow.views import plots


def steps():
    names = [f"step_{k:02d}" for k in range(22)]
    values = np.random.default_rng(1).random(22)
    gap = [None, *values[1:]]
    panels = {"σ [–]": {"exx": 1e-5 * values, "eyy": gap}, "ZNSSD [–]": {"left": gap}, "distance [px]": {"all": values}}
    return plots.steps_figure(names, panels)


def profile():
    y = np.linspace(0, 80, 50)
    return plots.profile_figure(y, {"a": np.sin(y), "b": np.cos(y)}, "Y [mm]", "Hencky strain along y [–]")


FIGURES = [steps, profile]
every_figure = pytest.mark.parametrize("drawn", FIGURES, ids=lambda drawn: drawn.__name__)


@every_figure
def test_axes_have_units(drawn):
    """All but those along which things are named."""
    figure = drawn()
    labels = [axis.get_label_text() for axes in figure.axes if axes.axison for axis in (axes.xaxis, axes.yaxis)]
    named = {"", "step"}
    assert all(re.search(r"\[.+\]$", label) for label in labels if label not in named)
    assert sum(label not in named for label in labels) >= len([axes for axes in figure.axes if axes.axison]) / 2


@every_figure
def test_no_two_texts_overlap(drawn):
    figure = drawn()
    figure.draw_without_rendering()
    texts = drawn_texts(figure)
    assert len(texts) > 5
    for one, other in combinations(texts, 2):
        boxes = one.get_window_extent().padded(-1), other.get_window_extent().padded(-1)
        assert not boxes[0].overlaps(boxes[1]), (one.get_text(), other.get_text())


def drawn_texts(figure):
    """All texts that are drawn; an axis keeps labels beyond its ends that are not."""
    texts = [text for legend in figure.legends for text in legend.get_texts()]
    for axes in (axes for axes in figure.axes if axes.axison):
        texts += [axes.title, *axes.texts, *(axes.legend_.get_texts() if axes.legend_ else [])]
        for axis in (axes.xaxis, axes.yaxis):
            ticks = [label for tick in axis._update_ticks() for label in (tick.label1, tick.label2)]
            texts += [axis.label, axis.get_offset_text(), *ticks]
    return [text for text in texts if text.get_visible() and text.get_text().strip()]


@pytest.mark.slow
@pytest.mark.parametrize("form", ["png", "pdf", "svg"])
def test_equal_input_gives_equal_files(form):
    start = {"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}[form]
    content = plots.saved(profile(), form)
    assert content.startswith(start)
    assert content == plots.saved(profile(), form)
    assert plots.svg(profile()) == plots.svg(profile())


@every_figure
def test_a_figure_inside_a_page_asks_for_nothing_and_takes_the_pages_colour(drawn):
    text = plots.svg(drawn())
    ElementTree.fromstring(text)
    assert "currentColor" in text
    assert "http" not in text
    assert "#010203" not in text
    names, used = set(re.findall(r' id="([^"]+)"', text)), set(re.findall(r'(?:href="#|url\(#)([^")]+)', text))
    assert used <= names
    assert len({name.split("-")[0] for name in names}) == 1


def test_figures_of_a_page_share_no_names():
    names = [set(re.findall(r' id="([^"]+)"', plots.svg(drawn()))) for drawn in FIGURES]
    assert all(not one & other for one, other in combinations(names, 2))


def test_saved_figures_are_on_white():
    image = Image.open(BytesIO(plots.saved(profile(), "png"))).convert("RGBA")
    assert image.getpixel((0, 0)) == (255, 255, 255, 255)
