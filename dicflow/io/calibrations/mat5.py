"""MATLAB's files of version 5 to 7: arrays, text and structures of them.

Read here rather than by scipy, whose reader trusts the lengths in a file, so that a damaged one ends the process.
(MATLAB MAT-File Format, The MathWorks.) A file is a header of 128 bytes and a row of elements; an element is a tag with
its type and length, and its bytes. A variable is an element made of elements: flags, dimensions, name, contents.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

__all__ = ["Opaque", "read_mat"]

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXT = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16"}
_STRUCT, _CHAR, _OBJECT = 2, 4, 17
_NUMERIC = range(6, 16)
_MAX_BYTES = 50_000_000
_MAX_ELEMENTS = 100_000
_MAX_AXES = 64
_DEEPEST = 8


@dataclass(frozen=True)
class Opaque:
    """A variable of another kind than array, text or structure: an object, cell, sparse matrix or structures."""

    kind: int


class _Element(NamedTuple):
    kind: int
    data: memoryview


def read_mat(data: bytes) -> dict[str, Any]:
    """Variables by name: arrays of the file's shape, text, structures as dictionaries, and :class:`Opaque`.

    Raises ValueError for a damaged file, and for one that unpacks to more than a calibration ever is, with the reason.
    """
    marks = {b"IM": "<", b"MI": ">"}
    order = marks.get(data[_HEADER - 2 : _HEADER])
    if order is None:
        raise ValueError("the header is incomplete")
    return dict(_File(order).variables(memoryview(data)[_HEADER:]))


class _File:
    """Reads one file, and counts what it unpacks to and its elements.

    order : of the bytes in a number, ``<`` or ``>``
    """

    def __init__(self, order: str) -> None:
        self.order = order
        self._bytes_left = _MAX_BYTES
        self._elements_left = _MAX_ELEMENTS

    def variables(self, data: memoryview) -> Iterator[tuple[str, Any]]:
        """Name and value of each variable that has a name."""
        for element in self._elements(data):
            if element.kind in (_MATRIX, _COMPRESSED):
                name, value = self._variable(self._unpacked(element), 0)
                if name:
                    yield name, value

    def _elements(self, data: memoryview) -> Iterator[_Element]:
        """The elements in these bytes; data up to 4 bytes long are part of the tag."""
        place = 0
        while place < len(data):
            if len(data) - place < 8:
                raise ValueError("the file ends within a tag")
            self._elements_left -= 1
            if self._elements_left < 0:
                raise ValueError(f"it has more than {_MAX_ELEMENTS:,} elements")
            kind, length = struct.unpack_from(f"{self.order}II", data, place)
            start, step = place + 8, length if kind == _COMPRESSED else -(-length // 8) * 8
            if kind >> 16:
                kind, length, start, step = kind & 0xFFFF, kind >> 16, place + 4, 0
            if start + length > len(data) or (step == 0 and length > 4):
                raise ValueError("an element is longer than the file")
            yield _Element(kind, data[start : start + length])
            place += 8 + step

    def _unpacked(self, element: _Element) -> memoryview:
        """The contents of a variable, which may be compressed."""
        if element.kind == _MATRIX:
            return element.data
        unpacking = zlib.decompressobj()
        try:
            data = unpacking.decompress(element.data, self._bytes_left + 1)
        except zlib.error as error:
            raise ValueError("a variable cannot be unpacked") from error
        self._bytes_left -= len(data)
        if self._bytes_left < 0:
            raise ValueError(f"its variables unpack to more than {_MAX_BYTES:,} bytes")
        inner = next(self._elements(memoryview(data)), None)
        if inner is None or inner.kind != _MATRIX:
            raise ValueError("a variable unpacks to something else")
        return inner.data

    def _variable(self, data: memoryview, depth: int) -> tuple[str, Any]:
        """Name and value of a variable, or of a structure's field, which has no name."""
        parts = list(self._elements(data))
        if not parts:
            return "", np.zeros((0, 0))
        if len(parts) < 3 or len(parts[0].data) < 4 or depth > _DEEPEST:
            raise ValueError("a variable is incomplete")
        (kind,) = struct.unpack_from(f"{self.order}I", parts[0].data)
        kind &= 0xFF
        if kind == _OBJECT:
            return _latin(parts[1].data), Opaque(kind)
        name, rest = _latin(parts[2].data), parts[3:]
        shape = tuple(int(side) for side in self._numbers(parts[1])[:_MAX_AXES])
        if min(shape, default=-1) < 0:
            raise ValueError("a variable has no shape")
        if kind == _STRUCT:
            return name, self._structure(rest, depth) if shape == (1, 1) else Opaque(kind)
        if kind == _CHAR:
            return name, self._text(rest)
        return name, self._array(rest, shape) if kind in _NUMERIC else Opaque(kind)

    def _numbers(self, element: _Element) -> np.ndarray:
        if element.kind not in _NUMBERS:
            raise ValueError(f"numbers have the unknown type {element.kind}")
        dtype = np.dtype(self.order + _NUMBERS[element.kind])
        if len(element.data) % dtype.itemsize:
            raise ValueError("the data end within a number")
        return np.frombuffer(element.data, dtype)

    def _array(self, parts: list[_Element], shape: tuple[int, ...]) -> np.ndarray:
        values = self._numbers(parts[0]) if parts else np.zeros(0)
        if len(parts) > 1:
            raise ValueError("an array has imaginary parts")
        if values.size != math.prod(shape):
            raise ValueError(f"an array of {shape} has {values.size} numbers")
        return values.reshape(shape, order="F")

    def _text(self, parts: list[_Element]) -> str:
        if not parts or not parts[0].data:
            return ""
        encoding = _TEXT.get(parts[0].kind, "latin-1")
        ending = {"<": "-le", ">": "-be"}[self.order] if encoding == "utf-16" else ""
        return bytes(parts[0].data).decode(encoding + ending, errors="replace")

    def _structure(self, parts: list[_Element], depth: int) -> dict[str, Any]:
        """A structure: the length of its fields' names, all names, and the values."""
        if len(parts) < 2:
            raise ValueError("a structure is incomplete")
        lengths, names, values = self._numbers(parts[0]), bytes(parts[1].data), parts[2:]
        width = int(lengths[0]) if lengths.size == 1 else 0
        if width <= 0 or len(names) != width * len(values):
            raise ValueError("the names of a structure's fields do not match its values")
        if any(value.kind != _MATRIX for value in values):
            raise ValueError("a field of a structure is not a variable")
        fields = (_latin(names[start : start + width].split(b"\0")[0]) for start in range(0, len(names), width))
        return {field: self._variable(value.data, depth + 1)[1] for field, value in zip(fields, values, strict=True)}


def _latin(data: bytes | memoryview) -> str:
    return bytes(data).decode("latin-1")
