"""MP4 files with damaged frames and other times: the boxes of ISO 14496-12, as far as OpenCV writes them."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence

__all__ = ["Mp4"]

_TABLES = ("moov", "trak", "mdia", "minf", "stbl")
"""Boxes, from the outside, that hold the tables of frames; the index stands behind the frames."""


class Mp4:
    """A video of one track in one chunk, as OpenCV writes it. content : of the file"""

    def __init__(self, content: bytes) -> None:
        self._content = content

    def with_frame(self, number: int, made: Callable[[int], bytes]) -> bytes:
        """The file with other bytes in a frame. number : from 1; made : gives so many bytes"""
        sizes = self._numbers("stsz", 12)
        start = self._numbers("stco", 8)[0] + sum(sizes[: number - 1])
        size = sizes[number - 1]
        return self._content[:start] + made(size) + self._content[start + size :]

    def with_gap(self, after: int, intervals: int) -> bytes:
        """The file where the frame after so many frames comes so many intervals later than the one before."""
        (count, interval), *_ = struct.iter_unpack(">II", self._table("stts")[8:])
        return self.with_intervals([intervals * interval if k == after else interval for k in range(1, count + 1)])

    def with_intervals(self, intervals: Sequence[int]) -> bytes:
        """The file with other times. intervals : from each frame to the next, in units of the track"""
        rows = b"".join(struct.pack(">II", 1, interval) for interval in intervals)
        table = struct.pack(">II", 0, len(intervals)) + rows
        content, places = bytearray(self._content), self._places("stts")
        start, size = places[-1]
        content[start : start + size] = struct.pack(">I4s", 8 + len(table), b"stts") + table
        for outer, length in places[:-1]:
            content[outer : outer + 4] = struct.pack(">I", length + 8 + len(table) - size)
        return bytes(content)

    def _numbers(self, name: str, skipped: int) -> list[int]:
        return [one for (one,) in struct.iter_unpack(">I", self._table(name)[skipped:])]

    def _table(self, name: str) -> bytes:
        start, size = self._places(name)[-1]
        return self._content[start + 8 : start + size]

    def _places(self, name: str) -> list[tuple[int, int]]:
        """Start and size of the boxes around a table, and of itself."""
        places, start, end = [], 0, len(self._content)
        for kind in (*_TABLES, name):
            start, size = self._box(kind, start, end)
            places.append((start, size))
            start, end = start + 8, start + size
        return places

    def _box(self, kind: str, start: int, end: int) -> tuple[int, int]:
        while start < end:
            size, found = struct.unpack(">I4s", self._content[start : start + 8])
            if found == kind.encode():
                return start, size
            start += size
        raise AssertionError(f"no box {kind}")
