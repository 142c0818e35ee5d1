"""Blocks of metadata, EXIF and XMP, in JPEG and PNG files."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from itertools import islice
from typing import BinaryIO

from dicflow.io.images.png import chunks

__all__ = ["jpeg_segments", "metadata"]

_XMP_OF_PNG, _XMP_OF_JPEG, _EXIF_OF_JPEG = b"XML:com.adobe.xmp", b"http://ns.adobe.com/xap/1.0/\0", b"Exif\0\0"
_PROFILES = (b"Raw profile type exif", b"Raw profile type APP1")
_MOST_BYTES, _MOST_BLOCKS = 1 << 20, 10
"""Size of a block of metadata that is looked at, unpacked [bytes], and number of these blocks."""
_APP1, _SCAN = 0xE1, 0xDA
"""Markers of JPEG (ITU-T T.81, table B.1): metadata, start of scan."""


def metadata(file: BinaryIO, form: str) -> Iterator[bytes]:
    """The first blocks of EXIF and XMP metadata of an open JPEG or PNG file, as they are; damaged ones too."""
    return islice({"PNG": _png_metadata, "JPEG": _jpeg_metadata}[form](file), _MOST_BLOCKS)


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
