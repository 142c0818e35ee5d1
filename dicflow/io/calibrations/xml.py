"""XML from unknown sources: parsed without entities, which could read other files or expand without limit."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree
from xml.parsers import expat

from dicflow.errors import InputError

__all__ = ["parse_xml"]


def parse_xml(path: Path, data: bytes) -> ElementTree.Element:
    """The root of a document. Raises InputError with the place for damaged XML and for entities."""
    parser = expat.ParserCreate()

    def refuse(*_: object) -> NoReturn:
        raise InputError(
            f"{path}:{parser.CurrentLineNumber}: declares an XML entity, which no calibration needs; export it again"
        )

    parser.EntityDeclHandler = refuse
    parser.ExternalEntityRefHandler = refuse
    try:
        parser.Parse(data, True)
        return ElementTree.fromstring(data)
    except (expat.ExpatError, ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"{path}: is damaged XML ({error}); export the calibration again") from error
