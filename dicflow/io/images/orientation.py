"""The orientation tag of a photograph: where it is written, what it means, and which way up the pipeline counts.

A camera writes it by its sense of gravity, and may so change it between two photographs although nothing has moved.
So a photograph is measured as the sensor lies; its tag counts only if the pipeline asks for ``upright``.
"""

from __future__ import annotations

import re
from io import BytesIO
from typing import BinaryIO, Literal

import numpy as np

from dicflow.io.images.metadata import metadata
from dicflow.io.images.tiff import Tiff

__all__ = ["Orientation", "exif_orientation", "orientation_sentence", "turned_upright", "upright_size"]

Orientation = Literal["sensor", "upright"]
"""Photographs as the sensor lies, or turned as their tag says."""

_XMP = re.compile(rb'tiff:Orientation(?:="|>)([1-8])')
_TURNS = {
    2: ("mirrored left to right", "{w} − x", "y"),
    3: ("turned by 180°", "{w} − x", "{h} − y"),
    4: ("mirrored top to bottom", "x", "{h} − y"),
    5: ("mirrored and turned by 90°", "y", "x"),
    6: ("turned by 90° clockwise", "y", "{h} − x"),
    7: ("mirrored and turned by 90°", "{w} − y", "{h} − x"),
    8: ("turned by 90° counter-clockwise", "{w} − y", "x"),
}
"""Tag → how a viewer shows the photograph, and the sensor's x and y of the viewer's pixel (x, y).

w, h : the last column and row of the sensor
"""


def orientation_sentence(orientation: int, width: int, height: int, upright: bool) -> str:
    """Which way up the pixels count; empty for a photograph without a tag that turns it.

    orientation : the tag, 1 … 8
    width, height : as the sensor lies [px]
    upright : whether the pipeline turns the photographs as their tag says

    >>> orientation_sentence(1, 640, 480, False)
    ''
    """
    if orientation not in _TURNS:
        return ""
    shown, x, y = _TURNS[orientation]
    if upright:
        size = "{} × {} px".format(*upright_size(orientation, width, height))
        return f"The photographs are measured {shown} as their tag says, {size}: x and y count as a viewer shows them."
    place = f"({x}, {y})".format(w=width - 1, h=height - 1)
    return (
        f"The photographs are tagged (orientation {orientation}): a viewer may show them {shown}. They are measured as "
        f"the sensor lies, {width} × {height} px: the viewer's pixel (x, y) is {place} here."
    )


def upright_size(orientation: int, width: int, height: int) -> tuple[int, int]:
    """Width and height after turning [px]."""
    return (height, width) if orientation >= 5 else (width, height)


def turned_upright(image: np.ndarray, orientation: int) -> np.ndarray:
    """An image (row, col) turned as its tag says (TIFF 6.0, tag 274)."""
    if orientation >= 5:
        image = image.T
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    return np.ascontiguousarray(image)


def exif_orientation(file: BinaryIO, form: str) -> int:
    """Orientation by the EXIF or XMP metadata of an open JPEG or PNG file; 1 if there are none, or damaged ones."""
    for block in metadata(file, form):
        if found := _XMP.search(block):
            return int(found[1])
        try:
            value = Tiff(BytesIO(block)).orientation()
        except ValueError:
            continue
        if 1 <= value <= 8:
            return value
    return 1
