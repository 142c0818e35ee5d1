"""Fields over photographs as small separate pictures, which a page lays one upon the other.

Pictures have their own pixels: those of a :class:`Crop` of the photograph.
"""

from __future__ import annotations

import base64
import math
import textwrap
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dicflow.views.cells import cells_at_pixels
from dicflow.views.colours import REASON_COLOURS, Look, palette
from dicflow.views.lettering import pitch
from dicflow.views.levels import field_levels, png_file
from dicflow.views.svg import text_element
from dicflow.views.ticks import ticks_that_fit

__all__ = [
    "Box",
    "Crop",
    "carried_angle",
    "cell_index",
    "colour_bar_svg",
    "crop_around",
    "direction_path",
    "field_png",
    "photo_jpeg",
    "point_box",
    "reason_png",
]

Array = NDArray[Any]
_COLOURS = 254
_TRANSPARENT = 255
_MARGIN = 0.05
_BAR_PX, _LETTERS, _LETTER_PX = 340, 54, 12


class Box(NamedTuple):
    """A part of an image, from the least to the largest place of its points [px]."""

    x0: float
    y0: float
    x1: float
    y1: float


class Crop(NamedTuple):
    """A part of a photograph at a scale.

    size : (width, height) of the picture [picture px]
    scale : picture px per image px, at most 1
    origin : (x, y) of the picture's upper left pixel in the image [image px]; whole numbers
    """

    size: tuple[int, int]
    scale: float
    origin: tuple[int, int]

    def place(self, xy: Array) -> Array:
        """Where points (..., 2) of the image [px] are in the picture [picture px], centres of pixels at integers."""
        return np.asarray((xy - np.array(self.origin) + 0.5) * self.scale - 0.5)

    @property
    def halved(self) -> Crop:
        """The same part at half the scale."""
        width, height = self.size
        return Crop((max(1, round(width / 2)), max(1, round(height / 2))), self.scale / 2, self.origin)


def point_box(xy: Array) -> Box | None:
    """The part of an image in which points (..., 2) lie [px]; None if all are unknown."""
    known = xy[np.isfinite(xy).all(axis=-1)]
    return Box(*known.min(axis=0).tolist(), *known.max(axis=0).tolist()) if len(known) else None


def crop_around(
    boxes: Iterable[tuple[float, float, float, float]], image_size: tuple[int, int], longest_px: int
) -> Crop:
    """The part of the image in which all boxes lie, with a margin.

    boxes : (x0, y0, x1, y1) [px], of all steps so that all their pictures agree; without boxes the whole image
    image_size : (width, height) [px]
    longest_px : neither side of the picture is longer
    """
    width, height = image_size
    corners = np.array(list(boxes) or [(0, 0, width, height)], dtype=float)
    low, high = corners[:, :2].min(axis=0), corners[:, 2:].max(axis=0)
    margin = max(_MARGIN * (high - low).max(), 1.0)
    x0, y0 = (int(edge) for edge in np.clip(np.floor(low - margin), 0, [width - 2, height - 2]))
    x1, y1 = (int(edge) for edge in np.clip(np.ceil(high + margin) + 1, [x0 + 2, y0 + 2], [width, height]))
    scale = min(1.0, longest_px / max(x1 - x0, y1 - y0))
    return Crop((max(1, round((x1 - x0) * scale)), max(1, round((y1 - y0) * scale))), scale, (x0, y0))


def photo_jpeg(image: Array, crop: Crop, quality: int = 70) -> bytes:
    """The crop of a photograph (row, col), uint8 or uint16, as a JPEG."""
    import cv2

    (x0, y0), (width, height) = crop.origin, crop.size
    part = image[y0 : y0 + round(height / crop.scale), x0 : x0 + round(width / crop.scale)]
    if image.dtype != np.uint8:
        from dicflow.core.photographs.texture import saturation_level

        part = np.clip(part * (255.0 / saturation_level(image)), 0, 255).astype(np.uint8)
    shrunk = cv2.resize(part, crop.size, interpolation=cv2.INTER_AREA)
    done, coded = cv2.imencode(".jpg", shrunk, [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done
    return coded.tobytes()


def cell_index(xy: Array, crop: Crop) -> NDArray[np.int32]:
    """Which cell of a grid each pixel of the picture shows; see :func:`dicflow.views.cells.cells_at_pixels`.

    xy : (row, col, 2) places of the grid's points in the image [px]
    """
    return cells_at_pixels(crop.place(xy), crop.size)


def field_png(values: Array, index: NDArray[np.int32], look: Look) -> bytes:
    """A field in the colours of its look, transparent where it is unknown.

    values : (row, col) at the points of the grid; a cell has the mean of its corners
    index : of :func:`cell_index` for the same grid
    """
    levels = field_levels(values, index, look, _COLOURS, _TRANSPARENT)
    return png_file(levels, palette(look.table, _COLOURS), _TRANSPARENT)


def reason_png(status: NDArray[np.uint8]) -> bytes:
    """Status codes (row, col) with one pixel per point, in the colours of their reasons; transparent where measured."""
    colours = np.zeros((_TRANSPARENT, 3), np.uint8)
    for code, colour in REASON_COLOURS.items():
        colours[code] = list(bytes.fromhex(colour[1:]))
    known = np.isin(status, list(REASON_COLOURS))
    return png_file(np.where(known, status, _TRANSPARENT).astype(np.uint8), colours, _TRANSPARENT)


def direction_path(grid: Array, angle_deg: Array, crop: Crop, count: int = 300) -> str:
    """Short lines along a direction at evenly chosen points of a grid, as the path of an SVG in picture px.

    grid : (row, col, 2) places of the points in the image [px]
    angle_deg : (row, col) from x to y [deg]; NaN has no line
    count : about how many lines are drawn if every angle is known
    """
    stride = max(1, math.ceil(math.sqrt(angle_deg.size / count)))
    chosen = (slice(stride // 2, None, stride),) * 2
    places, angles = crop.place(grid[chosen]), np.radians(angle_deg[chosen])
    known = np.isfinite(places).all(axis=-1) & np.isfinite(angles)
    steps = np.concatenate([np.diff(crop.place(grid), axis=axis).reshape(-1, 2) for axis in (0, 1)])
    steps = steps[np.isfinite(steps).all(axis=1)]
    if not known.any() or not len(steps):
        return ""
    half = 0.4 * stride * float(np.median(np.hypot(*steps.T)))
    reach = half * np.stack([np.cos(angles), np.sin(angles)], axis=-1)[known]
    lines = np.concatenate([places[known] - reach, places[known] + reach], axis=1)
    return "".join(f"M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}" for x0, y0, x1, y1 in lines)


def carried_angle(before: Array, after: Array, angle_deg: Array) -> Array:
    """Where material lines along a direction at one step point at another.

    before, after : (row, col, 2) places of the same points at the two steps [px]
    angle_deg : (row, col) at the one before, from x to y [deg]
    Returns (row, col) [deg]: of J d, where J = ∂after/∂before is of central differences along rows and columns; NaN
    where a neighbour is missing.
    """
    before, after = (np.stack([np.gradient(xy, axis=axis) for axis in (1, 0)], axis=-1) for xy in (before, after))
    x, y = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    (a, b), (c, d) = np.moveaxis(before, (-2, -1), (0, 1))
    along = np.stack([d * x - b * y, a * y - c * x], axis=-1) * np.sign(a * d - b * c)[..., None]
    turned = np.einsum("...ij,...j->...i", after, along)
    return np.asarray(np.degrees(np.arctan2(turned[..., 1], turned[..., 0])))


def colour_bar_svg(look: Look) -> str:
    """The colours of a look, its values below and its label above, as an SVG in the colour of the surrounding text."""
    numbers = ticks_that_fit(*look.range, lambda share, texts: share * _BAR_PX >= pitch(texts, _LETTER_PX))
    levels = np.arange(_COLOURS, dtype=np.uint8)[None]
    bar = base64.b64encode(png_file(levels, palette(look.table, _COLOURS))).decode()
    lines = textwrap.wrap(look.label, _LETTERS)
    top, width, margin, beside = 15 * len(lines) + 5, _BAR_PX, 30, 40 if numbers.factor else 0
    texts = [
        *(text_element(width / 2 + margin, 12 + 15 * row, line) for row, line in enumerate(lines)),
        *(
            text_element(margin + width * share, top + 27, text)
            for share, text in zip(numbers.shares, numbers.texts, strict=True)
        ),
        text_element(margin + width + 5, top + 11, numbers.factor, anchor="start"),
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width + 2 * margin + beside} {top + 32}" class="bar"'
        f' font-family="sans-serif" font-size="{_LETTER_PX}" fill="currentColor" text-anchor="middle">'
        f'<image x="{margin}" y="{top}" width="{width}" height="12" preserveAspectRatio="none"'
        f' href="data:image/png;base64,{bar}"/>{"".join(texts)}</svg>'
    )
