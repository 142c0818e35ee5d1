"""Photographs written byte by byte: forms of TIFF, PNG and BMP that the libraries do not write."""

from __future__ import annotations

import struct
import zlib

import numpy as np

__all__ = ["bitmap", "png", "tiff", "tiff_of_samples"]


def tiff(pages, order="<", big=False, more=()):
    """A TIFF file of 8 or 16 bits of grey, one strip per page.

    more : for each page further tags {number: value}, which replace those of the same number
    """
    word, entry = ("Q", "HHQQ") if big else ("I", "HHII")
    start = struct.pack(f"{order}H", 43 if big else 42) + (struct.pack(f"{order}HHQ", 8, 0, 16) if big else b"")
    start += b"" if big else struct.pack(f"{order}I", 8)
    data = (b"II" if order == "<" else b"MM") + start
    for k, page in enumerate(pages):
        samples = page.astype(page.dtype.newbyteorder(order)).tobytes()
        tags = {
            256: page.shape[1],
            257: page.shape[0],
            258: 8 * page.itemsize,
            259: 1,
            262: 1,
            277: 1,
            278: page.shape[0],
        }
        tags |= {279: len(samples), 273: 0} | (more[k] if k < len(more) else {})
        size = struct.calcsize(order + ("Q" if big else "H")) + len(tags) * struct.calcsize(order + entry)
        size += struct.calcsize(order + word)
        tags[273] = len(data) + size
        following = len(data) + size + len(samples) if k + 1 < len(pages) else 0
        rows = b"".join(
            struct.pack(order + entry, tag, 16 if big else 4, 1, value) for tag, value in sorted(tags.items())
        )
        data += struct.pack(order + ("Q" if big else "H"), len(tags)) + rows + struct.pack(order + word, following)
        data += samples
    return data


def tiff_of_samples(samples, extra=None, planar=False):
    """A TIFF file of several samples per pixel (row, col, sample), in one strip or in one for each plane."""
    rows, cols, count = samples.shape
    strips = np.moveaxis(samples, 2, 0) if planar else samples[None]
    size = strips[0].nbytes
    tags = {256: [cols], 257: [rows], 258: [8 * samples.itemsize] * count, 259: [1], 262: [2 if count > 2 else 1]}
    tags |= {277: [count], 278: [rows], 284: [2 if planar else 1], 279: [size] * len(strips)}
    tags |= {273: [8 + k * size for k in range(len(strips))]} | ({} if extra is None else {338: [extra]})
    data, entries = b"".join(strip.astype("<u2" if samples.itemsize == 2 else "u1").tobytes() for strip in strips), b""
    for tag, values in sorted(tags.items()):
        packed = struct.pack(f"<{len(values)}I", *values)
        entries += struct.pack("<HHI", tag, 4, len(values))
        entries += packed if len(values) == 1 else struct.pack("<I", 8 + len(data))
        data += packed if len(values) > 1 else b""
    start = struct.pack("<I", 8 + len(data))
    return b"II*\0" + start + data + struct.pack("<H", len(tags)) + entries + bytes(4)


def png(samples, colour, extra=b""):
    """A PNG file of 16 bits. colour : type of its colour; extra : content of tRNS"""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in samples)
    header = struct.pack(">IIBBBBB", samples.shape[1], samples.shape[0], 16, colour, 0, 0, 0)
    before = chunk(b"tRNS", extra) if extra else b""
    head = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header)
    return head + before + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


def bitmap(grey, opacity):
    """A BMP file of 32 bits per pixel that declares the fourth byte as opacity."""
    pixels = np.dstack([grey, grey, grey, opacity])[::-1].astype(np.uint8).tobytes()
    header = struct.pack("<IiiHHIIiiII", 108, grey.shape[1], grey.shape[0], 1, 32, 3, len(pixels), 0, 0, 0, 0)
    header += struct.pack("<IIII", 0xFF0000, 0xFF00, 0xFF, 0xFF000000) + b"BGRs" + bytes(48)
    start = 14 + len(header)
    return b"BM" + struct.pack("<IHHI", start + len(pixels), 0, 0, start) + header + pixels
