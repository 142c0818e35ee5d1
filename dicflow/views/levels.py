"""Pictures as numbers of the colours of a palette."""

from __future__ import annotations

from collections.abc import Iterable
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dicflow.views.colours import Look, palette

__all__ = [
    "COLOURS",
    "UNKNOWN",
    "Levels",
    "cell_means",
    "field_levels",
    "gif_file",
    "grey_levels",
    "opened",
    "png_file",
    "sheet_palette",
]

Levels = NDArray[np.uint8]
"""(row, col) numbers of colours."""

COLOURS, _GREYS = 224, 32
"""On a sheet, the colours of a table are followed by greys from black to white."""
UNKNOWN = COLOURS + _GREYS - 3
"""Light grey, where nothing is known."""


def sheet_palette(table: str) -> NDArray[np.uint8]:
    """The colours of a sheet, (256, 3) RGB. table : name of a matplotlib colour map"""
    greys = np.linspace(0, 255, _GREYS).round().astype(np.uint8)
    return np.concatenate([palette(table, COLOURS), np.repeat(greys[:, None], 3, axis=1)])


def grey_levels(image: Image.Image) -> Levels:
    """A picture in grey levels in the colours of a sheet."""
    return (COLOURS + (np.asarray(image, np.uint16) * (_GREYS - 1) + 127) // 255).astype(np.uint8)


def cell_means(values: NDArray[Any]) -> NDArray[Any]:
    """Means (row − 1, col − 1) of the corners of each cell of a grid; NaN where one is unknown."""
    return np.asarray((values[:-1, :-1] + values[1:, :-1] + values[:-1, 1:] + values[1:, 1:]) / 4.0)


def field_levels(
    values: NDArray[Any], index: NDArray[np.int32], look: Look, count: int = COLOURS, unknown: int = UNKNOWN
) -> Levels:
    """A field as a picture, each cell in the mean of its corners; beyond the range is the colour of its end.

    values : (row, col) at the points of the grid
    index : number of the cell at each pixel, −1 for none, as :func:`dicflow.views.cells.cells_at_pixels` gives it
    count : of the colours of the look's table
    unknown : number of the colour of pixels without a value
    """
    low, high = look.range
    cells = cell_means(values)
    with np.errstate(invalid="ignore"):
        levels = np.clip((cells - low) / (high - low) * count, 0, count - 1)
    known = np.where(np.isfinite(cells), np.nan_to_num(levels), unknown).astype(np.uint8)
    return np.append(known.ravel(), np.uint8(unknown))[index]


def png_file(levels: Levels, colours: NDArray[np.uint8], transparent: int | None = None) -> bytes:
    """A picture as a PNG; equal pictures give equal bytes.

    colours : (n, 3) RGB; transparent : number of the colour that is none
    """
    buffer = BytesIO()
    clear = {} if transparent is None else {"transparency": transparent}
    _image(levels, colours).save(buffer, "PNG", optimize=False, **clear)
    return buffer.getvalue()


def gif_file(frames: Iterable[Levels], colours: NDArray[np.uint8], seconds: float = 0.5) -> bytes:
    """Pictures of one size as an animated GIF that repeats. seconds : for which each is shown"""
    first, *others = (_image(frame, colours) for frame in frames)
    buffer = BytesIO()
    first.save(buffer, "GIF", save_all=True, append_images=others, duration=int(seconds * 1000), loop=0)
    return buffer.getvalue()


def opened(png: bytes) -> Levels:
    """The picture in a file that :func:`png_file` has made."""
    return np.asarray(Image.open(BytesIO(png)))


def _image(levels: Levels, colours: NDArray[np.uint8]) -> Image.Image:
    image = Image.fromarray(np.ascontiguousarray(levels))
    padded = np.zeros((256, 3), np.uint8)
    padded[: len(colours)] = colours
    image.putpalette(padded.tobytes())
    return image
