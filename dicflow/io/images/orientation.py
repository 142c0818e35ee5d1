"""The orientation tag of a photograph: where it is written, what it means, and which way up the pipeline counts.

A camera writes it by its sense of gravity, and may so change it between two photographs although nothing has moved.
So a photograph is measured as the sensor lies; its tag counts only if the pipeline asks for ``upright``.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator
from io import BytesIO
from itertools import islice
from typing import BinaryIO, Literal

import numpy as np

from dicflow.io.images.png import chunks
from dicflow.io.images.tiff import Tiff

__all__ = ["Orientation", "exif_orientation", "jpeg_segments", "orientation_sentence", "turned_upright", "upright_size"]

Orientation = Literal["sensor", "upright"]
"""Photographs as the sensor lies, or turned as their tag says."""

_XMP = re.compile(rb'tiff:Orientation(?:="|>)([1-8])')
_XMP_OF_PNG, _XMP_OF_JPEG, _EXIF_OF_JPEG = b"XML:com.adobe.xmp", b"http://ns.adobe.com/xap/1.0/\0", b"Exif\0\0"
_PROFILES = (b"Raw profile type exif", b"Raw profile type APP1")
_MOST_BYTES, _MOST_BLOCKS = 1 << 20, 10
"""Size of a block of metadata that is looked at, unpacked [bytes], and number of these blocks."""
_APP1, _SCAN = 0xE1, 0xDA
"""Markers of JPEG (ITU-T T.81, table B.1): metadata, start of scan."""
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
    for metadata in islice({"PNG": _png_metadata, "JPEG": _jpeg_metadata}[form](file), _MOST_BLOCKS):
        if found := _XMP.search(metadata):
            return int(found[1])
        try:
            value = Tiff(BytesIO(metadata)).orientation()
        except ValueError:
            continue
        if 1 <= value <= 8:
            return value
    return 1


def jpeg_segments(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Marker, place of the content and its length, of each segment up to the first scan of a JPEG file."""
    place = 2
    while place + 4 <= len(data) and data[place] == 0xFF and data[place + 1] != _SCAN:
        if data[place + 1] == 0xFF:
            place += 1
            continue
        length = int.from_bytes(data[place + 2 : place + 4], "big")
        yield data[place + 1], place + 4, length - 2
        place += 2 + length


def _jpeg_metadata(file: BinaryIO) -> Iterator[bytes]:
    file.seek(0)
    data = file.read(_MOST_BYTES)
    for marker, place, length in jpeg_segments(data):
        content = data[place : place + length]
        if marker == _APP1 and content.startswith(_EXIF_OF_JPEG):
            yield content[len(_EXIF_OF_JPEG) :]
        elif marker == _APP1 and content.startswith(_XMP_OF_JPEG):
            yield content


def _png_metadata(file: BinaryIO) -> Iterator[bytes]:
    for kind, place, length in chunks(file):
        if kind in (b"eXIf", b"tEXt", b"zTXt", b"iTXt"):
            file.seek(place)
            content = file.read(min(length, _MOST_BYTES))
            if kind == b"eXIf" or content.startswith(_XMP_OF_PNG):
                yield content
            elif content.startswith(_PROFILES):
                yield _profile(kind, content)


def _profile(kind: bytes, content: bytes) -> bytes:
    """EXIF metadata that ImageMagick writes as hexadecimal text, packed or not; empty if damaged."""
    text = content.partition(b"\0")[2]
    try:
        if kind == b"zTXt":
            text = zlib.decompressobj().decompress(text[1:], _MOST_BYTES)
        digits = b"".join(text.split(b"\n")[3:])
        return bytes.fromhex(digits.decode("ascii")).removeprefix(_EXIF_OF_JPEG)
    except (ValueError, zlib.error):
        return b""
