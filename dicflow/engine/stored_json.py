"""JSON files of the store: each a mapping of a known form, with a check sum of its own.

The check sum is the mapping's first entry and covers every byte behind it::

    {"crc32":"5d41402a","key":…}

CRC-32 finds accidents: flipped bits, files cut short, blocks of zeros after a power failure. It does not stop anybody
who may write into the store. A file without a check sum was written by an earlier release, and is taken for what it
says. Anything that does not fit raises ValueError, which the readers of a file take for a missing one.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from dicflow.engine.whole_file import LARGEST_TEXT, NotRegularError, read_file

__all__ = [
    "Form",
    "anything",
    "fields",
    "is_count",
    "is_flag",
    "is_number",
    "is_text",
    "list_of",
    "mapping_of",
    "one_of",
    "read_stored",
    "seal",
    "stored",
    "unseal",
]

Form = Callable[[Any], bool]
"""Whether a JSON value has a form."""

_HEAD = b'{"crc32":"'
_SUM_END = len(_HEAD) + 8
_MOST_VALUES = 10_000_000
"""Index files of a million tasks have fewer; each value takes about 100 bytes of memory."""
_DEEPEST = 100
"""Deeper values are refused, since code that follows a value into its depth could run out of stack."""


def seal(value: Mapping[str, Any]) -> bytes:
    """A mapping as JSON with its check sum, in one line."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"))
    # a file name in a message may not be valid Unicode: its bytes are written as escapes
    body = text.encode("utf-8", "backslashreplace")[1:]
    rest = body if body == b"}" else b"," + body
    return b'%b%08x"%b' % (_HEAD, zlib.crc32(rest), rest)


def unseal(content: bytes, form: Form) -> Any:
    """The mapping that :func:`seal` or an earlier release wrote.

    Raises ValueError where the check sum differs, and for what is not JSON or has another form.
    """
    rest = memoryview(content)[_SUM_END + 1 :]
    fits = content[len(_HEAD) : _SUM_END] == b"%08x" % zlib.crc32(rest)
    if fits and content.startswith(_HEAD) and content[_SUM_END : _SUM_END + 1] == b'"':
        value = _parsed(b"{%b" % bytes(rest).removeprefix(b","))
    elif fits or content.startswith(_HEAD):
        raise ValueError("the check sum differs")
    else:
        value = _parsed(content)
    if not isinstance(value, dict) or not form(value):
        raise ValueError("holds something else than it should")
    return value


def read_stored(path: Path, form: Form) -> Any:
    """The mapping in a file. Raises OSError where it cannot be read, ValueError where it is damaged."""
    try:
        content = read_file(path, LARGEST_TEXT)
    except NotRegularError as error:
        raise ValueError(f"is {error.strerror}") from error
    return unseal(content, form)


def stored(path: Path, form: Form) -> Any:
    """The mapping in a file; None if it is missing, damaged, or cannot be read."""
    try:
        return read_stored(path, form)
    except (OSError, ValueError):
        return None


# forms


def anything(_value: Any) -> bool:
    """Whether a value is JSON."""
    return True


def is_text(value: Any) -> bool:
    """Whether a value is a text."""
    return isinstance(value, str)


def is_flag(value: Any) -> bool:
    """Whether a value is true or false."""
    return isinstance(value, bool)


def is_number(value: Any) -> bool:
    """Whether a value is a finite number, up to 1e300."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= 1e300


def is_count(value: Any) -> bool:
    """Whether a value is 0, 1, 2, …"""
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def one_of(*values: str) -> Form:
    """The values given."""
    return lambda value: value in values


def list_of(form: Form) -> Form:
    """Lists whose items have a form."""
    return lambda value: isinstance(value, list) and all(map(form, value))


def mapping_of(form: Form, names: Form = anything) -> Form:
    """Mappings whose values have a form, and whose names another one."""
    return lambda value: isinstance(value, dict) and all(map(names, value)) and all(map(form, value.values()))


def fields(needed: Mapping[str, Form], more: Mapping[str, Form] | None = None) -> Form:
    """Mappings that have an entry of its form for each needed name, perhaps some more, and no others."""
    known = {**needed, **(more or {})}

    def fits(value: Any) -> bool:
        if not isinstance(value, dict) or not needed.keys() <= value.keys() <= known.keys():
            return False
        return all(known[name](item) for name, item in value.items())

    return fits


def _parsed(content: bytes) -> Any:
    """A JSON value in UTF-8. Raises ValueError."""
    if content.count(b",") + content.count(b"[") + content.count(b"{") > _MOST_VALUES:
        raise ValueError("has too many values")
    try:
        value = json.loads(content if content[:1] == b"{" else content.decode("utf-8-sig"))
    except RecursionError as error:
        raise ValueError("is nested too deeply") from error
    except ValueError as error:
        raise ValueError("is not JSON" if content.strip(b"\0") else "is empty") from error
    if content.count(b"[") + content.count(b"{") > _DEEPEST and _is_deep(value):
        raise ValueError("is nested too deeply")
    return value


def _is_deep(value: Any) -> bool:
    level = [value]
    for _ in range(_DEEPEST):
        inside = (one.values() if type(one) is dict else one for one in level)  # json makes no subclasses
        level = [part for parts in inside for part in parts if type(part) is dict or type(part) is list]
        if not level:
            return False
    return True
