"""XML from unknown sources: parsed without entities and default attributes, which could read other files or expand.

The number and depth of elements are limited before a tree is made of them.
"""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree
from xml.parsers import expat

from dicflow.errors import InputError
from dicflow.io.text import printable

__all__ = ["parse_xml"]


_MAX_ELEMENTS = 100_000
_MAX_DEPTH = 100
_EXPORT = "export the calibration again"


def parse_xml(path: Path, data: bytes) -> ElementTree.Element:
    """The root of a document. Raises InputError with the place for damaged XML, and for declarations."""
    parser = expat.ParserCreate()
    count = depth = 0

    def fail(problem: str) -> NoReturn:
        raise InputError(f"{path}:{parser.CurrentLineNumber}", problem, _EXPORT)

    def refuse(*_: object) -> NoReturn:
        fail("has declarations, such as an XML entity, which no calibration needs")

    def start(_: str, attributes: dict[str, str]) -> None:
        nonlocal count, depth
        count, depth = count + 1 + len(attributes), depth + 1
        if count > _MAX_ELEMENTS or depth > _MAX_DEPTH:
            fail(f"has more than {_MAX_ELEMENTS:,} elements and attributes, or {_MAX_DEPTH} inside each other")

    def end(*_: object) -> None:
        nonlocal depth
        depth -= 1

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.EntityDeclHandler = parser.ExternalEntityRefHandler = parser.AttlistDeclHandler = refuse
    try:
        parser.Parse(data, True)
        return ElementTree.fromstring(data)
    except (expat.ExpatError, ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(str(path), f"is damaged XML ({printable(error)})", _EXPORT) from error
