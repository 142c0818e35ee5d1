"""Maps of a test as pixels: one step alone, and many side by side."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from dicflow.engine.product import Product
from dicflow.views.cells import cells_at_pixels
from dicflow.views.colours import Look
from dicflow.views.lettering import text_width, widest
from dicflow.views.levels import Levels, field_levels, png_file
from dicflow.views.sheets import LARGE, SMALL, Sheet, sheet
from dicflow.views.windows import MapWindow

__all__ = ["contact_sheet", "map_cells", "map_levels", "map_png", "map_sheet", "map_tile", "maps_of_steps"]

_HIGHEST_PX, _WIDEST_PX = 550, 990
_SMALL_HIGHEST_PX, _SMALL_WIDEST_PX = 240, 384
_SMALLER_PX = (200, 160, 130, 100, 80, 60)
"""Heights of maps that are drawn smaller."""
_PAGE_PX, _GAP_PX = 1400, 15


def map_tile(window: MapWindow) -> tuple[int, int]:
    """Width and height of a map that stands alone [px]."""
    return _tile(window.aspect, _HIGHEST_PX, _WIDEST_PX)


def map_cells(total: Product, window: MapWindow, tile: tuple[int, int]) -> NDArray[np.int32]:
    """Which cell of the grid lies at each pixel of a map; see :func:`dicflow.views.cells.cells_at_pixels`."""
    x0, y0, x1, y1 = window.extent
    places = (total[window.positions][..., :2] - (x0, y0)) / (x1 - x0, y1 - y0) * tile - 0.5
    return cells_at_pixels(places, tile)


def map_levels(total: Product, look: Look, window: MapWindow) -> Levels:
    """A map alone, without axes."""
    return field_levels(total[look.quantity], map_cells(total, window, map_tile(window)), look)


def map_sheet(look: Look, window: MapWindow, titles: Iterable[str]) -> Sheet:
    """The sheet for maps that stand alone, with room for the longest title."""
    longest = max(titles, key=lambda title: text_width(title, LARGE.name))
    return sheet(window, look, map_tile(window), [longest])


def map_png(total: Product, look: Look, window: MapWindow, title: str) -> bytes:
    """One step as a PNG: the field where the specimen is, with axes in its unit and a colour bar."""
    page = map_sheet(look, window, [title])
    return png_file(page.filled([map_levels(total, look, window)], [title]), page.colours)


def maps_of_steps(
    page: Sheet, totals: Iterable[Product], look: Look, window: MapWindow, titles: Sequence[str]
) -> Iterator[Levels]:
    """Maps of many steps, one held at a time. page : that of :func:`map_sheet` for them"""
    for total, title in zip(totals, titles, strict=True):
        yield page.filled([map_levels(total, look, window)], [title])


def contact_sheet(
    maps: Sequence[Levels], names: Sequence[str], look: Look, window: MapWindow, title: str, highest: float = math.inf
) -> bytes:
    """Many maps side by side with one colour bar, as a PNG.

    maps : each of any size in the window's proportion
    highest : height that all maps together may have [px]; they are drawn smaller for it, down to a limit
    """
    for height in (_SMALL_HIGHEST_PX, *_SMALLER_PX):
        tile = _tile(window.aspect, height, _SMALL_WIDEST_PX)
        pitch = max(tile[0], widest(names, SMALL.name)) + _GAP_PX
        columns = max(1, min(len(names), _PAGE_PX // pitch))
        if math.ceil(len(names) / columns) * (tile[1] + 2 * _GAP_PX) <= highest:
            break
    page = sheet(window, look, tile, names, columns, title, SMALL)
    return png_file(page.filled([_sampled(levels, tile) for levels in maps], names), page.colours)


def _tile(aspect: float, highest: int, widest: int) -> tuple[int, int]:
    width = min(highest * aspect, widest)
    return max(1, round(width)), max(1, round(width / aspect))


def _sampled(levels: Levels, size: tuple[int, int]) -> Levels:
    """A picture at another size, from the pixel at the middle of each new one."""
    rows, columns = (
        ((np.arange(new) + 0.5) * (old / new)).astype(int) for new, old in zip(size[::-1], levels.shape, strict=True)
    )
    return np.asarray(levels[rows[:, None], columns])
