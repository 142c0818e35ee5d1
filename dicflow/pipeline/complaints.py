"""Messages for values of a pipeline file that do not fit, each with its place."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError

from dicflow.discovery import nearest
from dicflow.io.configuration import Document, Place
from dicflow.io.text import printable

__all__ = ["complaints"]

_MAX_SHOWN = 200
_MAX_PROBLEMS = 50
"""Of one part of the file; more are not looked at."""


def complaints(
    document: Document, place: Place, model: type[BaseModel], error: ValidationError, known: Sequence[str]
) -> list[str]:
    """What is wrong with a part of a file: one line per place, for several forms of a value of the one that fits best.

    place, model : where the part is, and what validated it
    known : keys that it may have
    """
    details: list[dict[str, Any]] = [dict(detail) for detail in error.errors()[:_MAX_PROBLEMS]]
    placed: dict[Place, list[dict[str, Any]]] = {}
    for detail in details:
        placed.setdefault(_path(document, place, detail["loc"]), []).append(detail)
    deepest = [path for path in placed if not path or not any(_within(path, other) for other in placed)]
    return [_complaint(document, place, model, known, path, placed[path]) for path in deepest]


def _within(path: Place, other: Place) -> bool:
    return len(other) > len(path) and other[: len(path)] == path


def _complaint(
    document: Document,
    place: Place,
    model: type[BaseModel],
    known: Sequence[str],
    path: Place,
    details: list[dict[str, Any]],
) -> str:
    """One line for the errors of pydantic at one place."""
    first = details[0]
    where = document.where((*place, *path))
    named = path or tuple(itertools.takewhile(_is_name, first["loc"]))
    dotted = ".".join(str(part) for part in (place[-1], *named))
    field = model.model_fields.get(str(first["loc"][0])) if first["loc"] else None
    meaning = field.description if field is not None and field.description else "a value"
    if first["type"] == "extra_forbidden":
        word = str(first["loc"][-1])
        return f"{where}: {dotted}: unknown parameter{_slip(word, known)}; it takes {', '.join(known)}"
    if first["type"] == "missing":
        lack = "has too few values" if path and isinstance(first["loc"][-1], int) else "is missing"
        return f"{where}: {dotted}: {lack}; give {meaning}"
    details = [detail for detail in details if detail["type"] == "value_error"] or details
    message = " or ".join(dict.fromkeys(_pydantic_message(detail) for detail in details)).replace(
        " or must be ", " or "
    )
    if not first["loc"]:
        return f"{where}: {dotted}: {message}"
    found = printable(repr(details[0]["input"]), _MAX_SHOWN)
    return f"{where}: {dotted}: {message}" + ("" if found in message else f", found {found}") + f"; give {meaning}"


def _slip(word: str, known: Sequence[str]) -> str:
    """What was most likely meant by an unknown parameter, with the blank or the point that is missing."""
    name, sign, value = (part.strip() for part in re.match(r"([^:=]*)([:=]?)(.*)", word, re.DOTALL).groups())  # type: ignore[union-attr]
    if sign and name in known:
        return f"; write '{name}: {value}', with a colon and a blank"
    if word[:1].isdigit():
        return "; write decimals with a point, and lists in brackets [ ]"
    return nearest(word, known)


def _is_name(part: str | int) -> bool:
    """Whether a part of an error's location is a parameter or an index, not one of several forms."""
    return isinstance(part, int) or (part.isidentifier() and part.islower())


def _pydantic_message(detail: Mapping[str, Any]) -> str:
    """Pydantic's message in the words of a pipeline file."""
    numbers = {"int_parsing": "must be a whole number, without a unit", "float_parsing": "must be a number"}
    if detail["type"] in numbers:
        return numbers[detail["type"]]
    forms = {"tuple_type": "a list", "list_type": "a list", "model_type": "a mapping", "string_type": "text"}
    if detail["type"] in forms:
        return f"must be {forms[detail['type']]}"
    message = re.sub(r"^Value error, ", "", detail["msg"]).replace("Input should be", "must be")
    return message[:1].lower() + message[1:]


def _path(document: Document, place: Place, location: tuple[str | int, ...]) -> Place:
    """The part of an error's location that is in the file; tags of unions are not."""
    path: Place = ()
    for part in location:
        if document.holds((*place, *path, part)):
            path = (*path, part)
    return path
