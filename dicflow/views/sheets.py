"""Maps side by side with axes and a colour bar, drawn as pixels.

A sheet is laid out once, with all its texts; then only the maps and their names are put in.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dicflow.views.colour_bar import ColourBar, colour_bar
from dicflow.views.colours import Look
from dicflow.views.lettering import Paper, line_height, pitch, text_width, widest, wrapped
from dicflow.views.levels import Levels, grey_levels, sheet_palette
from dicflow.views.ticks import Ticks, ticks_that_fit
from dicflow.views.windows import MapWindow

__all__ = ["LARGE", "SMALL", "Sheet", "sheet"]

_EDGE, _GAP, _PAD, _TICK = 11, 15, 4, 4
"""Distances [px]: of anything from the edge, of two maps, of two texts; length of a tick."""
_LEAST_UPRIGHT, _LEAST_TITLE = 230, 280
"""Height of the maps from which the bar stands beside them; width that a title may always have [px]."""


class Letters(NamedTuple):
    """Heights of the letters [px]: numbers and labels of the axes, names of the maps, title, and at the bar."""

    tick: float
    axis: float
    name: float
    title: float
    bar: float


LARGE = Letters(tick=14, axis=14, name=13, title=14, bar=14)
SMALL = Letters(tick=10, axis=11, name=11, title=14, bar=12)


class Sheet(NamedTuple):
    """A picture without its maps and their names.

    ground : (height, width)
    tile : (width, height) of a map [px]
    corners : (x, y) of the upper left pixel of each
    colours : (256, 3) RGB
    name_px : height of the letters of the names
    """

    ground: Levels
    tile: tuple[int, int]
    corners: tuple[tuple[int, int], ...]
    colours: NDArray[np.uint8]
    name_px: float

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture [px]."""
        height, width = self.ground.shape
        return width, height

    def filled(self, maps: Sequence[Levels], names: Sequence[str]) -> Levels:
        """The whole picture. maps : (height, width) of a tile each, as many as there are corners"""
        picture = self.ground.copy()
        for place, (levels, name) in enumerate(zip(maps, names, strict=True)):
            self.map_in(picture, place)[:] = levels
            self._put_name(picture, self.corners[place], name)
        return picture

    def map_in(self, picture: Levels, place: int = 0) -> Levels:
        """The part of a picture that shows one of the maps."""
        (x, y), (width, height) = self.corners[place], self.tile
        return picture[y : y + height, x : x + width]

    def _put_name(self, picture: Levels, corner: tuple[int, int], name: str) -> None:
        width, height = math.ceil(text_width(name, self.name_px)), line_height(self.name_px)
        paper = Paper((width, height))
        paper.text(width / 2, height / 2, name, self.name_px)
        x, y = corner[0] + (self.tile[0] - width) // 2, corner[1] - _PAD - height
        picture[y : y + height, x : x + width] = grey_levels(paper.image)


class _Axes(NamedTuple):
    """The axes of a map.

    x, y : numbers along them
    unit : of both
    """

    x: Ticks
    y: Ticks
    unit: str
    letters: Letters

    @property
    def left(self) -> int:
        """Room for numbers and label beside a map [px]."""
        return line_height(self.letters.axis) + 2 * _PAD + widest(self.y.texts, self.letters.tick) + _TICK

    @property
    def below(self) -> int:
        """Room for numbers and label below a map [px]."""
        return _TICK + line_height(self.letters.tick) + _PAD // 2 + line_height(self.letters.axis)


class _Grid(NamedTuple):
    """Rows and columns of maps.

    pitch : distance of two maps in x and y [px]
    overhang : width of the longest name beyond either side of its map [px]
    """

    maps: int
    columns: int
    tile: tuple[int, int]
    pitch: tuple[int, int]
    overhang: int

    @property
    def size(self) -> tuple[int, int]:
        """Width and height from the first map to the last [px]."""
        rows = math.ceil(self.maps / self.columns)
        return self.tile[0] + (self.columns - 1) * self.pitch[0], self.tile[1] + (rows - 1) * self.pitch[1]

    def corners(self, left: int, top: int) -> tuple[tuple[int, int], ...]:
        """Upper left pixel of each map, from that of the first."""
        places = (divmod(place, self.columns) for place in range(self.maps))
        return tuple((left + column * self.pitch[0], top + row * self.pitch[1]) for row, column in places)

    def is_outer(self, place: int) -> tuple[bool, bool]:
        """Whether a map stands at the left edge, and at the end of its column."""
        return place % self.columns == 0, place + self.columns >= self.maps


def sheet(
    window: MapWindow,
    look: Look,
    tile: tuple[int, int],
    names: Sequence[str],
    columns: int = 1,
    title: str = "",
    letters: Letters = LARGE,
) -> Sheet:
    """The sheet of as many maps as there are names, row by row.

    tile : (width, height) of a map [px]
    names : shorter ones may be written in their places
    """
    axes, grid = _axes(window, tile, letters), _grid(tile, names, columns, letters)
    upright = grid.size[1] >= _LEAST_UPRIGHT
    bar = colour_bar(look, grid.size[1 if upright else 0], upright, letters.bar)
    lines = _title_lines(title, letters, axes.left + grid.size[0] + (bar.thickness if upright else 0))
    left = _EDGE + max(axes.left, grid.overhang)
    top = _EDGE + len(lines) * line_height(letters.title) + line_height(letters.name) + 2 * _PAD
    bar_at = _bar_corner(bar, grid, axes, left, top)
    paper = Paper(_size(bar, bar_at, grid, axes, lines))
    corners = grid.corners(left, top)
    for place, corner in enumerate(corners):
        _draw_axes(paper, axes, corner, tile, grid.is_outer(place))
    bar.draw(paper, *bar_at)
    for row, line in enumerate(lines):
        paper.text(paper.image.width / 2, _EDGE + (row + 0.5) * line_height(letters.title), line, letters.title)
    ground = grey_levels(paper.image)
    bar.fill(ground, *bar_at)
    return Sheet(ground, tile, corners, sheet_palette(look.table), letters.name)


def _axes(window: MapWindow, tile: tuple[int, int], letters: Letters) -> _Axes:
    (x0, y0, x1, y1), (width, height) = window.extent, tile

    def fits_across(share: float, texts: Sequence[str]) -> bool:
        return share * width >= pitch(texts, letters.tick)

    def fits_down(share: float, _texts: Sequence[str]) -> bool:
        return share * height >= 2 * letters.tick

    x, y = ticks_that_fit(x0, x1, fits_across), ticks_that_fit(y0, y1, fits_down)
    return _Axes(x, y, window.unit, letters)


def _grid(tile: tuple[int, int], names: Sequence[str], columns: int, letters: Letters) -> _Grid:
    name = widest(names, letters.name)
    pitch = max(tile[0], name) + _GAP, tile[1] + line_height(letters.name) + 2 * _PAD + _GAP // 2
    return _Grid(len(names), columns, tile, pitch, max(0, math.ceil((name - tile[0]) / 2)))


def _title_lines(title: str, letters: Letters, width: int) -> list[str]:
    return wrapped(title, letters.title, max(width, _LEAST_TITLE)) if title else []


def _bar_corner(bar: ColourBar, grid: _Grid, axes: _Axes, left: int, top: int) -> tuple[int, int]:
    width, height = grid.size
    if bar.upright:
        return left + width + max(_GAP, grid.overhang + _PAD), top
    return left, top + height + axes.below + _GAP + (line_height(bar.size_px) if bar.numbers.factor else 0)


def _size(bar: ColourBar, bar_at: tuple[int, int], grid: _Grid, axes: _Axes, lines: Sequence[str]) -> tuple[int, int]:
    """Width and height of the picture: all that is drawn, with an edge."""
    x, y = bar_at
    title = widest(lines, axes.letters.title)
    if bar.upright:
        right, below = x + bar.thickness, y + bar.extent + axes.below
    else:
        right, below = x + max(bar.extent, bar.length + grid.overhang), y + bar.thickness
    return max(right, title + _EDGE) + _EDGE, below + _EDGE


def _draw_axes(
    paper: Paper, axes: _Axes, corner: tuple[int, int], tile: tuple[int, int], outer: tuple[bool, bool]
) -> None:
    """Outline and ticks of a map; numbers and labels where it stands at the left, or at the end of its column."""
    paper.box(*corner, *tile)
    _draw_left(paper, axes, corner, tile[1], outer[0])
    _draw_below(paper, axes, (corner[0], corner[1] + tile[1]), tile[0], outer[1])


def _draw_left(paper: Paper, axes: _Axes, corner: tuple[int, int], height: int, labelled: bool) -> None:
    (x, y), letters = corner, axes.letters
    for share, text in zip(axes.y.shares, axes.y.texts, strict=True):
        at = y + round(share * (height - 1))
        paper.line(x - 1 - _TICK, at, _TICK - 1, 0)
        if labelled:
            paper.text(x - _TICK - _PAD, at, text, letters.tick, "rm")
    if labelled:
        paper.upright(x - axes.left + line_height(letters.axis) / 2, y + height / 2, f"Y [{axes.unit}]", letters.axis)


def _draw_below(paper: Paper, axes: _Axes, corner: tuple[int, int], width: int, labelled: bool) -> None:
    (x, y), letters = corner, axes.letters
    for share, text in zip(axes.x.shares, axes.x.texts, strict=True):
        at = x + round(share * (width - 1))
        paper.line(at, y + 1, 0, _TICK - 1)
        if labelled:
            paper.text(at, y + _TICK + line_height(letters.tick) / 2, text, letters.tick)
    if labelled:
        middle = y + axes.below - line_height(letters.axis) / 2
        paper.text(x + width / 2, middle, f"X [{axes.unit}]", letters.axis)
