"""A colour bar as pixels, beside the maps or below them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dicflow.views.colours import Look
from dicflow.views.lettering import Paper, line_height, pitch, widest, wrapped
from dicflow.views.levels import COLOURS, Levels
from dicflow.views.ticks import Ticks, ticks_that_fit

__all__ = ["ColourBar", "colour_bar"]

_WIDTH, _TICK, _PAD = 16, 4, 4
_LEAST_LABEL = 150
"""Length that a line of the label may always have [px]."""


class ColourBar(NamedTuple):
    """A bar with its numbers and its label.

    upright : whether it stands, with its high end above, or lies, with its high end at the right
    length : of the bar [px]
    label : in lines
    size_px : height of the letters
    """

    upright: bool
    length: int
    numbers: Ticks
    label: tuple[str, ...]
    size_px: float

    @property
    def thickness(self) -> int:
        """Room across its length [px]."""
        numbers = widest(self.numbers.texts, self.size_px) if self.upright else line_height(self.size_px)
        return _WIDTH + _TICK + _PAD + numbers + _PAD + len(self.label) * line_height(self.size_px)

    @property
    def extent(self) -> int:
        """Room along its length [px]."""
        return max(self.length, widest(self.label, self.size_px))

    def draw(self, paper: Paper, x: int, y: int) -> None:
        """Draw the outline, the numbers and the label. x, y : upper left corner of the bar [px]"""
        paper.box(x, y, *self._sides)
        for share, text in zip(self.numbers.shares, self.numbers.texts, strict=True):
            self._draw_number(paper, x, y, share, text)
        self._draw_factor(paper, x, y)
        for number, line in enumerate(self.label):
            self._draw_line(paper, x, y, line, len(self.label) - number - 0.5)

    def fill(self, picture: Levels, x: int, y: int) -> None:
        """Put the colours in."""
        width, height = self._sides
        levels = ((np.arange(self.length) + 0.5) * COLOURS / self.length).astype(np.uint8)
        picture[y : y + height, x : x + width] = levels[::-1, None] if self.upright else levels

    @property
    def _sides(self) -> tuple[int, int]:
        return (_WIDTH, self.length) if self.upright else (self.length, _WIDTH)

    def _draw_number(self, paper: Paper, x: int, y: int, share: float, text: str) -> None:
        if self.upright:
            right, middle = x + _WIDTH, y + round((1 - share) * (self.length - 1))
            paper.line(right + 1, middle, _TICK - 1, 0)
            paper.text(right + _TICK + _PAD, middle, text, self.size_px, "lm")
        else:
            middle, below = x + round(share * (self.length - 1)), y + _WIDTH
            paper.line(middle, below + 1, 0, _TICK - 1)
            paper.text(middle, below + _TICK + line_height(self.size_px) / 2, text, self.size_px)

    def _draw_factor(self, paper: Paper, x: int, y: int) -> None:
        """Above the high end."""
        at, anchor = (x, "ls") if self.upright else (x + self.length, "rs")
        paper.text(at, y - 2 * _PAD, self.numbers.factor, self.size_px, anchor)

    def _draw_line(self, paper: Paper, x: int, y: int, line: str, lines_from_edge: float) -> None:
        depth = self.thickness - lines_from_edge * line_height(self.size_px)
        if self.upright:
            paper.upright(x + depth, y + self.length / 2, line, self.size_px)
        else:
            paper.text(x + self.length / 2, y + depth, line, self.size_px)


def colour_bar(look: Look, length: int, upright: bool, size_px: float) -> ColourBar:
    """The bar of a look. length : [px]; size_px : height of the letters"""

    def fits(share: float, texts: Sequence[str]) -> bool:
        return share * length >= (2 * size_px if upright else pitch(texts, size_px) + size_px)

    numbers = ticks_that_fit(*look.range, fits)
    return ColourBar(upright, length, numbers, tuple(wrapped(look.label, size_px, max(length, _LEAST_LABEL))), size_px)
