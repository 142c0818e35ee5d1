"""Parts of photographs as small pictures, which have pixels of their own: those of a :class:`Crop`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Box",
    "Crop",
    "crop_around",
    "photo_jpeg",
    "point_box",
]

Array = NDArray[Any]
_MARGIN = 0.05


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
