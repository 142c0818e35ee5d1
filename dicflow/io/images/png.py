"""Chunks of PNG files (ISO 15948, with the chunks of animations and of EXIF metadata)."""

from __future__ import annotations

import os
from collections.abc import Iterator
from io import BytesIO
from typing import BinaryIO, NamedTuple

__all__ = ["Animation", "animation", "chunks", "without_metadata"]

_SIGNATURE = 8
_MOST_FRAMES = 100_000
_NEEDED = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")


class Animation(NamedTuple):
    """The frames of a PNG file; one without animation has a single one.

    first : number of the first frame as libraries count; a default image that is not part of the animation is their 0
    """

    frames: int
    first: int


def chunks(file: BinaryIO) -> Iterator[tuple[bytes, int, int]]:
    """Type, place of the data and their length, of every chunk of an open file up to its end or the first damage."""
    end = file.seek(0, os.SEEK_END)
    place = _SIGNATURE
    while place + 8 <= end:
        file.seek(place)
        head = file.read(8)
        length = int.from_bytes(head[:4], "big")
        yield head[4:], place + 8, length
        place += 12 + length


def without_metadata(data: bytes) -> bytes:
    """A PNG file with only what its samples depend on: libraries print complaints about colour profiles and text.

    Raises ValueError if it is truncated; OpenCV would reserve as much memory as a chunk claims.
    """
    kept = [data[:_SIGNATURE]]
    for kind, place, length in chunks(BytesIO(data)):
        if place + length + 4 > len(data):
            raise ValueError("it ends inside a chunk")
        if kind in _NEEDED:
            kept.append(data[place - 8 : place + length + 4])
    return b"".join(kept)


def animation(file: BinaryIO) -> Animation:
    """The frames of a file. Raises ValueError for more than a series can have."""
    before: list[bytes] = []
    for kind, _, _ in chunks(file):
        if kind == b"IDAT":
            break
        before.append(kind)
    if b"acTL" not in before:
        return Animation(1, 0)
    frames = sum(kind == b"fcTL" for kind, _, _ in chunks(file))
    if frames > _MOST_FRAMES:
        raise ValueError(f"{frames} frames")
    return Animation(max(frames, 1), int(frames > 1 and b"fcTL" not in before))
