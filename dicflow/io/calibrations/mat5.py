"""MATLAB's files of version 5 to 7: arrays, text and structures of them.

Read here rather than by scipy, whose reader trusts the lengths in a file, so that a damaged one ends the process.
(MATLAB MAT-File Format, The MathWorks.) A file is a header of 128 bytes and a row of elements; an element is a tag with
its type and length, and its bytes. A variable is an element made of elements: flags, dimensions, name, contents.
"""

from __future__ import annotations

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
_MAX_BYTES = 100_000_000
_DEEPEST = 8


@dataclass(frozen=True)
class Opaque:
    """A variable of another kind than array, text or structure: an object, cell, sparse matrix or structures."""

    kind: int


class _Element(NamedTuple):
    kind: int
    data: bytes


def read_mat(data: bytes) -> dict[str, Any]:
    """Variables by name: arrays of the file's shape, text, structures as dictionaries, and :class:`Opaque`.

    Raises ValueError for a damaged file, with the reason.
    """
    marks = {b"IM": "<", b"MI": ">"}
    order = marks.get(data[_HEADER - 2 : _HEADER])
    if order is None:
        raise ValueError("the header is incomplete")
    variables = dict(
        _variable(_unpacked(element, order), order, 0)
        for element in _elements(data[_HEADER:], order)
        if element.kind in (_MATRIX, _COMPRESSED)
    )
    return {name: value for name, value in variables.items() if name}


def _elements(data: bytes, order: str) -> Iterator[_Element]:
    """The elements in these bytes; data up to 4 bytes long are part of the tag."""
    place = 0
    while place < len(data):
        if len(data) - place < 8:
            raise ValueError("the file ends within a tag")
        kind, length = (int(word) for word in np.frombuffer(data, f"{order}u4", 2, place))
        start, step = place + 8, length if kind == _COMPRESSED else -(-length // 8) * 8
        if kind >> 16:
            kind, length, start, step = kind & 0xFFFF, kind >> 16, place + 4, 0
        if start + length > len(data) or (step == 0 and length > 4):
            raise ValueError("an element is longer than the file")
        yield _Element(kind, data[start : start + length])
        place += 8 + step


def _unpacked(element: _Element, order: str) -> bytes:
    """The contents of a variable, which may be compressed."""
    if element.kind == _MATRIX:
        return element.data
    unpacking = zlib.decompressobj()
    try:
        data = unpacking.decompress(element.data, _MAX_BYTES)
    except zlib.error as error:
        raise ValueError("a variable cannot be unpacked") from error
    if unpacking.unconsumed_tail:
        raise ValueError(f"a variable unpacks to more than {_MAX_BYTES:,} bytes")
    inner = next(_elements(data, order), _Element(0, b""))
    if inner.kind != _MATRIX:
        raise ValueError("a variable unpacks to something else")
    return inner.data


def _variable(data: bytes, order: str, depth: int) -> tuple[str, Any]:
    """Name and value of a variable, or of a structure's field, which has no name."""
    parts = list(_elements(data, order))
    if not parts:
        return "", np.zeros((0, 0))
    if len(parts) < 3 or len(parts[0].data) < 4 or depth > _DEEPEST:
        raise ValueError("a variable is incomplete")
    kind = int(np.frombuffer(parts[0].data, f"{order}u4", 1)[0]) & 0xFF
    if kind == _OBJECT:
        return parts[1].data.decode("latin-1"), Opaque(kind)
    name, rest = parts[2].data.decode("latin-1"), parts[3:]
    shape = tuple(int(side) for side in _numbers(parts[1], order))
    if min(shape, default=-1) < 0:
        raise ValueError("a variable has no shape")
    if kind == _STRUCT:
        return name, _structure(rest, order, depth) if shape == (1, 1) else Opaque(kind)
    if kind == _CHAR:
        return name, _text(rest, order)
    return name, _array(rest, shape, order) if kind in _NUMERIC else Opaque(kind)


def _numbers(element: _Element, order: str) -> np.ndarray:
    if element.kind not in _NUMBERS:
        raise ValueError(f"numbers have the unknown type {element.kind}")
    dtype = np.dtype(order + _NUMBERS[element.kind])
    if len(element.data) % dtype.itemsize:
        raise ValueError("the data end within a number")
    return np.frombuffer(element.data, dtype)


def _array(parts: list[_Element], shape: tuple[int, ...], order: str) -> np.ndarray:
    values = _numbers(parts[0], order) if parts else np.zeros(0)
    if len(parts) > 1:
        raise ValueError("an array has imaginary parts")
    if values.size != np.prod(shape, dtype=object):
        raise ValueError(f"an array of {shape} has {values.size} numbers")
    return values.reshape(shape, order="F")


def _text(parts: list[_Element], order: str) -> str:
    if not parts or not parts[0].data:
        return ""
    encoding = _TEXT.get(parts[0].kind, "latin-1")
    ending = {"<": "-le", ">": "-be"}[order] if encoding == "utf-16" else ""
    return parts[0].data.decode(encoding + ending, errors="replace")


def _structure(parts: list[_Element], order: str, depth: int) -> dict[str, Any]:
    """A structure: the length of its fields' names, all names, and the values."""
    if len(parts) < 2:
        raise ValueError("a structure is incomplete")
    lengths, names, values = _numbers(parts[0], order), parts[1].data, parts[2:]
    width = int(lengths[0]) if lengths.size == 1 else 0
    if width <= 0 or len(names) != width * len(values):
        raise ValueError("the names of a structure's fields do not match its values")
    if any(value.kind != _MATRIX for value in values):
        raise ValueError("a field of a structure is not a variable")
    fields = (names[start : start + width].split(b"\0")[0].decode("latin-1") for start in range(0, len(names), width))
    return {field: _variable(value.data, order, depth + 1)[1] for field, value in zip(fields, values, strict=True)}
