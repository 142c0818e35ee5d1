"""Figures as files: on white, and equal for equal input."""

from __future__ import annotations

from io import BytesIO

import pytest
from matplotlib.figure import Figure
from PIL import Image

from dicflow.views.plots import saved


def figure():
    drawn = Figure(figsize=(3.0, 2.0))
    drawn.subplots().plot([0, 1, 2], [1, 3, 2])
    return drawn


@pytest.mark.slow
@pytest.mark.parametrize("form", ["png", "pdf", "svg"])
def test_equal_input_gives_equal_files(form):
    start = {"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}[form]
    content = saved(figure(), form)
    assert content.startswith(start)
    assert content == saved(figure(), form)


def test_saved_figures_are_on_white():
    image = Image.open(BytesIO(saved(figure(), "png"))).convert("RGBA")
    assert image.getpixel((0, 0)) == (255, 255, 255, 255)
