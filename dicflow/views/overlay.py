"""Fields over photographs as small separate pictures, which a page lays one upon the other.

Pictures have their own pixels: those of a :class:`Crop` of the photograph. Libraries that draw are loaded by the
functions that need them, since a page whose pictures are all kept needs crops alone.
"""

from __future__ import annotations

import base64
import html
import math
import textwrap
from collections.abc import Iterable
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dicflow.views.colours import REASON_COLOURS, Look, palette

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
_SUBPIXEL_BITS = 4
_MARGIN = 0.05
_BAR_PX, _LETTERS = 340, 54


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

    from dicflow.core.photographs.texture import saturation_level

    (x0, y0), (width, height) = crop.origin, crop.size
    part = image[y0 : y0 + round(height / crop.scale), x0 : x0 + round(width / crop.scale)]
    if image.dtype != np.uint8:
        part = np.clip(part * (255.0 / saturation_level(image)), 0, 255).astype(np.uint8)
    shrunk = cv2.resize(part, crop.size, interpolation=cv2.INTER_AREA)
    done, coded = cv2.imencode(".jpg", shrunk, [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done
    return coded.tobytes()


def cell_index(xy: Array, crop: Crop) -> NDArray[np.int32]:
    """Which cell of a grid each pixel of the picture shows.

    xy : (row, col, 2) places of the grid's points in the image [px]; a cell with an unknown corner is not shown
    Returns (height, width) int32, the number of the cell in the order of rows, −1 outside the grid.
    """
    import cv2

    width, height = crop.size
    index = np.full((height, width), -1, np.int32)
    placed = crop.place(xy)
    corners = np.stack([placed[:-1, :-1], placed[:-1, 1:], placed[1:, 1:], placed[1:, :-1]], axis=2).reshape(-1, 4, 2)
    numbers = np.flatnonzero(np.isfinite(corners).all(axis=(1, 2)))
    fixed = np.rint(corners[numbers] * 2**_SUBPIXEL_BITS).astype(np.int32)
    for number, corner in zip(numbers.tolist(), fixed, strict=True):
        cv2.fillConvexPoly(index, corner, number, cv2.LINE_8, _SUBPIXEL_BITS)
    return index


def field_png(values: Array, index: NDArray[np.int32], look: Look) -> bytes:
    """A field in the colours of its look, transparent where it is unknown.

    values : (row, col) at the points of the grid; a cell has the mean of its corners
    index : of :func:`cell_index` for the same grid
    """
    cells = (values[:-1, :-1] + values[1:, :-1] + values[:-1, 1:] + values[1:, 1:]) / 4.0
    levels = np.append(_levels(cells, look).ravel(), np.uint8(_TRANSPARENT))
    return _palette_png(levels[index], palette(look.table, _COLOURS))


def reason_png(status: NDArray[np.uint8]) -> bytes:
    """Status codes (row, col) with one pixel per point, in the colours of their reasons; transparent where measured."""
    colours = np.zeros((_TRANSPARENT, 3), np.uint8)
    for code, colour in REASON_COLOURS.items():
        colours[code] = list(bytes.fromhex(colour[1:]))
    known = np.isin(status, list(REASON_COLOURS))
    return _palette_png(np.where(known, status, _TRANSPARENT).astype(np.uint8), colours)


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
    from matplotlib.ticker import MaxNLocator, ScalarFormatter

    low, high = look.range
    bar = base64.b64encode(_palette_png(np.arange(_COLOURS, dtype=np.uint8)[None], palette(look.table, _COLOURS)))
    lines = textwrap.wrap(look.label, _LETTERS)
    top = 15 * len(lines) + 5
    ticks = [tick for tick in MaxNLocator(5, steps=[1, 2, 5, 10]).tick_values(low, high) if low <= tick <= high]
    formatter = ScalarFormatter(useOffset=False)
    formatter.create_dummy_axis()
    formatter.axis.set_view_interval(low, high)  # type: ignore[union-attr]
    formatter.set_powerlimits((-99, 99))
    width, margin = _BAR_PX, 30
    return "".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width + 2 * margin} {top + 32}" class="bar"'
            ' font-family="sans-serif" font-size="12" fill="currentColor" text-anchor="middle">',
            *(
                f'<text x="{width / 2 + margin}" y="{12 + 15 * row}">{html.escape(line)}</text>'
                for row, line in enumerate(lines)
            ),
            f'<image x="{margin}" y="{top}" width="{width}" height="12" preserveAspectRatio="none"'
            f' href="data:image/png;base64,{bar.decode()}"/>',
            *(
                f'<text x="{margin + width * (tick - low) / (high - low):.1f}" y="{top + 27}">{text}</text>'
                for tick, text in zip(ticks, formatter.format_ticks(ticks), strict=True)
            ),
            "</svg>",
        ]
    )


def _levels(values: Array, look: Look) -> NDArray[np.uint8]:
    """Number of the colour of each value; values beyond the range have the colour of its end."""
    low, high = look.range
    with np.errstate(invalid="ignore"):
        levels = np.clip((values - low) / (high - low) * _COLOURS, 0, _COLOURS - 1)
    return np.where(np.isfinite(values), np.nan_to_num(levels), _TRANSPARENT).astype(np.uint8)


def _palette_png(levels: NDArray[np.uint8], colours: NDArray[np.uint8]) -> bytes:
    """Numbers of colours as a PNG with a palette, whose last entry is transparent."""
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(levels))
    padded = np.zeros((256, 3), np.uint8)
    padded[: len(colours)] = colours
    image.putpalette(padded.tobytes())
    buffer = BytesIO()
    image.save(buffer, "PNG", transparency=_TRANSPARENT, optimize=False)
    return buffer.getvalue()
