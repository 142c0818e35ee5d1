"""Pages of TIFF files (TIFF 6.0, and BigTIFF), each as a TIFF file of its own.

Libraries that decode TIFF follow all that a file holds: its further pages, the orientation, tags of unknown makers. So
one page is taken out first, with the tags that its grey levels depend on, and handed over alone.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Mapping, Sequence
from itertools import accumulate
from typing import BinaryIO, NamedTuple

from dicflow.engine.whole_file import LARGEST
from dicflow.errors import InputError

__all__ = ["MOST_PAGES", "Page", "Tiff"]

MOST_PAGES = 100_000
"""Pages of one file; a chain of more is taken for damage."""
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 13: 4, 16: 8, 17: 8, 18: 8}
"""Type of a tag's values → bytes of one value."""
_CODES = {1: "B", 3: "H", 4: "I", 13: "I", 16: "Q", 18: "Q"}
"""Types of whole numbers → code of struct."""

_BITS, _COMPRESSION, _PHOTOMETRIC, _DESCRIPTION, _ORIENTATION, _SAMPLES = 258, 259, 262, 270, 274, 277
_EXTRA_SAMPLES, _SAMPLE_FORMAT = 338, 339
_NEW_SUBFILE, _OLD_SUBFILE, _DNG_VERSION = 254, 255, 50706
_PLANAR, _IN_PLANES, _MOST_PLANES = 284, 2, 8
_STRIPS, _STRIP_BYTES, _TILES, _TILE_BYTES = 273, 279, 324, 325
_WIDTH, _HEIGHT, _ROWS, _TILE_WIDTH, _TILE_HEIGHT = 256, 257, 278, 322, 323
_OLD_JPEG, _OLD_REDUCED = 6, 2
_MOST_TAGS, _MOST_VALUES = 0xFFFF, 1_000_000
"""Tags of a page, values of a tag."""
_LONG = (16, 18)
_BLACK_IS_ZERO, _RGB, _COLOUR_FILTER, _LINEAR_RAW = 1, 2, 32803, 34892
_UNSIGNED, _ALPHA = 1, (1, 2)
_NUMBERS = {2: "numbers with signs", 3: "numbers with fractions", 6: "complex numbers"}
_NEEDED = {
    _BITS,
    _COMPRESSION,
    _PHOTOMETRIC,
    _SAMPLES,
    _EXTRA_SAMPLES,
    _SAMPLE_FORMAT,
    256,
    257,
    266,
    278,
    _PLANAR,
    292,
}
_OF_SAMPLES = {_BITS, _SAMPLES, _EXTRA_SAMPLES, _SAMPLE_FORMAT, _PHOTOMETRIC, _PLANAR}
_NEEDED |= {293, 317, 320, 322, 323, 332, 334, 347, 529, 530, 531, 532}
"""Tags that the decoding of the samples depends on, beside the places of the data."""
_REDUCED, _MASK = 1, 4
"""Bits of the tag NewSubfileType: a smaller copy of another page, a mask of one."""


class _Tag(NamedTuple):
    """One entry of a directory. place : where its values begin in the file [bytes]"""

    type: int
    length: int
    place: int


_Value = tuple[int, int, bytes]
"""Type, number and bytes of the values of a tag."""
Page = Mapping[int, _Tag]
"""An image file directory: number of the tag → entry."""


class Tiff:
    """An open TIFF file, or EXIF metadata, which have the same form.

    All methods raise ValueError where the file is damaged.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._size = file.seek(0, os.SEEK_END)
        start = self._read(0, 8)
        order = {b"II": "<", b"MM": ">"}.get(start[:2])
        if order is None:
            raise ValueError("no byte order")
        self._order = order
        self._big = struct.unpack_from(f"{order}H", start, 2)[0] == 43

    def photographs(self) -> list[Page]:
        """The pages that are photographs: neither smaller copies nor masks of another page.

        Raises InputError, without the file's name, for a stack whose pages have no directories of their own.
        """
        pages = [page for page in self._directories() if not self._is_copy(page)]
        described = _described_pages(self._raw(pages[0], _DESCRIPTION))
        if described > len(pages):
            raise InputError(
                f"ImageJ says that it holds {described} images, but {len(pages)} can be found in it; save them as an "
                "image sequence"
            )
        return pages

    def is_raw(self) -> bool:
        """Whether it is a camera's raw file: DNG, NEF, CR2 …"""
        pages = [page for page in self._directories() if not self._is_copy(page)]
        filtered = any(self._number(page, _PHOTOMETRIC, 1) in (_COLOUR_FILTER, _LINEAR_RAW) for page in pages)
        return not pages or filtered or any(_DNG_VERSION in page for page in pages)

    def orientation(self) -> int:
        """Orientation by the first directory, 0 if it is not given."""
        return self._number(next(self._directories()), _ORIENTATION, 0)

    def orientation_of(self, page: Page) -> int:
        """Orientation of a page, 1 if it is not given."""
        return self._number(page, _ORIENTATION, 1)

    def bits(self, page: Page) -> int:
        """Most bits of one sample."""
        return max(self._numbers(page, _BITS), default=1)

    def other_numbers(self, page: Page) -> str:
        """What the samples are if they are not unsigned whole numbers; "" if they are."""
        forms = self._numbers(page, _SAMPLE_FORMAT)
        return next((_NUMBERS.get(form, "unknown numbers") for form in forms if form != _UNSIGNED), "")

    def has_opacity(self, page: Page) -> bool:
        """Whether the last sample of a pixel is its opacity: it says so, or is the fourth after red, green and blue."""
        extra = self._numbers(page, _EXTRA_SAMPLES)
        if extra:
            return extra[-1] in _ALPHA
        return self._number(page, _PHOTOMETRIC, 1) == _RGB and self.samples(page) == 4

    def samples(self, page: Page) -> int:
        """Samples of one pixel."""
        return self._number(page, _SAMPLES, 1)

    def is_planar(self, page: Page) -> bool:
        """Whether the samples of a pixel lie in planes, one after the other."""
        return self.samples(page) > 1 and self._number(page, _PLANAR, 1) == _IN_PLANES

    def plane(self, page: Page, number: int) -> bytes:
        """A TIFF file of grey levels that holds one plane of a page."""
        count = self.samples(page)
        data = self._data(page)
        per_plane, rest = divmod(len(data), count)
        if rest or count > _MOST_PLANES:
            raise ValueError("its planes are not equally long, or too many")
        kept = {tag: value for tag, value in self._kept(page).items() if tag not in _OF_SAMPLES}
        kept |= {_BITS: _numbers(self._order, [self.bits(page)]), _PHOTOMETRIC: _numbers(self._order, [_BLACK_IS_ZERO])}
        return _joined(self._order, kept, self._names(page), data[number * per_plane : (number + 1) * per_plane])

    def alone(self, page: Page) -> bytes:
        """A TIFF file that holds one page and what its decoding depends on."""
        return _joined(self._order, self._kept(page), self._names(page), self._data(page))

    def _names(self, page: Page) -> tuple[int, int]:
        """Tags of the places and of the lengths of the data."""
        return (_TILES, _TILE_BYTES) if _TILES in page else (_STRIPS, _STRIP_BYTES)

    def _data(self, page: Page) -> list[bytes]:
        """The strips or tiles of a page."""
        places, sizes = self._names(page)
        if self._number(page, _COMPRESSION, 1) == _OLD_JPEG or places not in page:
            raise ValueError("its data cannot be found")
        starts = self._numbers(page, places)
        if len(starts) < self._parts(page):
            raise ValueError("strips or tiles are missing")  # libraries would leave their pixels black
        lengths = self._numbers(page, sizes) or self._rest(starts)
        sizes_here = [min(size, self._size - start) for start, size in zip(starts, lengths, strict=True)]
        if sum(sizes_here) > min(self._size, LARGEST):
            raise ValueError("its strips lie upon one another, or are too long")
        return [self._read(start, size) for start, size in zip(starts, sizes_here, strict=True)]

    def _parts(self, page: Page) -> int:
        """The number of strips or tiles that a page must have."""
        width, height = self._number(page, _WIDTH, 0), self._number(page, _HEIGHT, 0)
        across, down = (_TILE_WIDTH, _TILE_HEIGHT) if _TILES in page else (_WIDTH, _ROWS)
        columns, rows = self._number(page, across, width), self._number(page, down, height)
        if min(width, height, columns, rows) < 1:
            raise ValueError("it has no size")
        return -(-width // columns) * -(-height // rows) * (self.samples(page) if self.is_planar(page) else 1)

    def _kept(self, page: Page) -> dict[int, _Value]:
        """What the decoding of a page depends on, beside its data."""
        needed = {tag: entry for tag, entry in page.items() if tag in _NEEDED}
        if any(entry.length > _MOST_VALUES for entry in needed.values()):
            raise ValueError("a tag has too many values")
        kept = {tag: (*entry[:2], self._raw(page, tag)) for tag, entry in needed.items()}
        for tag in kept:
            if page[tag].type in _LONG:  # of BigTIFF alone
                kept[tag] = _numbers(self._order, self._numbers(page, tag))
        return kept

    def _directories(self) -> Iterator[Page]:
        place = self._integer(8, 8) if self._big else self._integer(4, 4)
        seen: set[int] = set()
        bytes_left = self._size
        while place:
            if place in seen or len(seen) >= MOST_PAGES:
                raise ValueError("its pages lead in a circle, or are too many")
            seen.add(place)
            page, end, following = self._directory(place)
            bytes_left -= end - place
            if bytes_left < 0:
                raise ValueError("its pages lie upon one another")
            yield page
            place = following
        if not seen:
            raise ValueError("no page")

    def _directory(self, place: int) -> tuple[Page, int, int]:
        """The directory at a place of the file, where it ends, and the place of the next, 0 after the last."""
        head, size, word = (8, 20, 8) if self._big else (2, 12, 4)
        count = self._integer(place, head)
        if count > _MOST_TAGS:
            raise ValueError("too many tags")
        table = self._read(place + head, count * size)
        tags = {}
        for k in range(count):
            tag, kind, values = struct.unpack_from(f"{self._order}HH{'Q' if self._big else 'I'}", table, k * size)
            held = place + head + (k + 1) * size - word
            if kind in _SIZES and values:
                inside = values * _SIZES[kind] <= word
                tags[tag] = _Tag(kind, values, held if inside else self._integer(held, word))
        after = place + head + len(table)
        return tags, after, self._integer(after, word) if after + word <= self._size else 0

    def _is_copy(self, page: Page) -> bool:
        """Whether a page shows another one smaller, or masks it."""
        kind = self._number(page, _NEW_SUBFILE, 0)
        return bool(kind & (_REDUCED | _MASK)) or self._number(page, _OLD_SUBFILE, 1) == _OLD_REDUCED

    def _rest(self, starts: tuple[int, ...]) -> tuple[int, ...]:
        """The length of a single strip that is not given: up to the end of the file."""
        if len(starts) != 1:
            raise ValueError("its strips have no lengths")
        return (self._size - starts[0],)

    def _raw(self, page: Page, tag: int) -> bytes:
        """The bytes of a tag's values; empty if it is missing."""
        entry = page.get(tag)
        return b"" if entry is None else self._read(entry.place, entry.length * _SIZES[entry.type])

    def _numbers(self, page: Page, tag: int) -> tuple[int, ...]:
        """The values of a tag of whole numbers; empty if it is missing."""
        entry = page.get(tag)
        if entry is None:
            return ()
        if entry.type not in _CODES:
            raise ValueError(f"tag {tag} does not hold whole numbers")
        if entry.length > _MOST_VALUES:
            raise ValueError(f"tag {tag} has too many values")
        return struct.unpack(f"{self._order}{entry.length}{_CODES[entry.type]}", self._raw(page, tag))

    def _number(self, page: Page, tag: int, default: int) -> int:
        """The first value of a tag."""
        entry = page.get(tag)
        return default if entry is None else self._numbers({tag: entry._replace(length=1)}, tag)[0]

    def _integer(self, place: int, size: int) -> int:
        return int.from_bytes(self._read(place, size), "little" if self._order == "<" else "big")

    def _read(self, place: int, size: int) -> bytes:
        if size < 0 or not 0 <= place <= self._size - size:
            raise ValueError("it ends before its data")
        self._file.seek(place)
        return self._file.read(size)


def _numbers(order: str, numbers: Sequence[int]) -> _Value:
    """Values of 32 bits. Raises ValueError for greater numbers."""
    if max(numbers) >= 1 << 32:
        raise ValueError("a page of more than 4 GB")
    return 4, len(numbers), struct.pack(f"{order}{len(numbers)}I", *numbers)


def _joined(order: str, kept: Mapping[int, _Value], names: tuple[int, int], data: list[bytes]) -> bytes:
    """A TIFF file: header, data, values of tags, directory.

    kept : tag → type, number and bytes of its values
    names : tags of the places and lengths of the data
    """
    lengths = [len(part) for part in data]
    starts = list(accumulate(lengths, initial=8))[:-1]
    tags = {**kept, names[0]: _numbers(order, starts), names[1]: _numbers(order, lengths)}
    end = 8 + sum(lengths)
    values, entries = [], []
    for tag, (kind, count, value) in sorted(tags.items()):
        held = value.ljust(4, b"\0")
        if len(value) > 4:
            held = struct.pack(f"{order}I", end)
            values.append(value)
            end += len(value)
        entries.append(struct.pack(f"{order}HHI", tag, kind, count) + held)
    directory = struct.pack(f"{order}H", len(entries)) + b"".join(entries) + bytes(4)
    header = (b"II" if order == "<" else b"MM") + struct.pack(f"{order}HI", 42, end)
    return b"".join([header, *data, *values, directory])


def _described_pages(description: bytes) -> int:
    """The number of images that ImageJ writes into the description; above 4 GB it keeps one directory for all."""
    if not description.startswith(b"ImageJ="):
        return 1
    lines = dict(line.partition(b"=")[::2] for line in description.splitlines())
    count = lines.get(b"images", b"1").strip(b"\0 ")
    return int(count) if count.isdigit() and len(count) < 10 else 1
