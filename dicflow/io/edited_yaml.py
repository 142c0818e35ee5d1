"""Edits of a YAML file by place, with comments, order and style kept."""

from __future__ import annotations

import copy
import difflib
import importlib.util
import io
import re
import sys
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

from dicflow.errors import ConfigurationError
from dicflow.io.configuration import Place, parse, parse_value

__all__ = ["REMOVED", "Edit", "edited", "require_editor"]

REMOVED = object()
"""In place of a value: the key goes."""
_MOST_ON_A_LINE = 8
"""Names in a list."""
_TO_FILL_IN = re.compile(r"^([^#\n]*\S)[ ]+# FILL IN the .*$", re.MULTILINE)

_REMARKS = re.compile(r"\n((?:[ \t]*(?:#[^\n]*)?\n)*(?:[ \t]*#[^\n]*)?)\Z")
_INDENTED = re.compile(r"^( +)[^ #\n]", re.MULTILINE)


class Edit(NamedTuple):
    """A new value at a place of a file, such as ``("stages", "total", "window")``."""

    place: Place
    value: Any


def require_editor() -> None:
    """Raise ConfigurationError where the library that edits YAML is not installed."""
    try:
        found = importlib.util.find_spec("ruamel.yaml")
    except ModuleNotFoundError:  # ruamel itself
        found = None
    if found is None:
        raise ConfigurationError(
            f"editing pipeline files needs ruamel.yaml, which the Python in {sys.prefix} does not have; "
            "install it there with: pip install 'dicflow[app]'"
        )


def edited(text: str, source: str, edits: Sequence[Edit]) -> str:
    """The text of a pipeline file with new values; lines without them stay as they are.

    Raises ConfigurationError if the text is no YAML, or if the values do not come back from what is written.
    """
    require_editor()
    wanted = copy.deepcopy(parse(text, source).data)
    yaml = _yaml(text)
    body, remarks = _parted(text)
    tree = _loaded(yaml, body)
    before = _dumped(yaml, tree)
    for place, value in edits:
        _put(wanted, place, value, copy.deepcopy)
        _put(tree, place, value, _styled, insert=_insert)
    whole = _dumped(yaml, tree)
    for after in (_only_changed(body, before, whole), whole):
        after = _TO_FILL_IN.sub(partial(_without_marker, {place[-1] for place, _ in edits}), after) + remarks
        if _holds(after, wanted):
            return after
    raise ConfigurationError(source, "this change cannot be written beside aliases or tags", "edit the file itself")


def _parted(text: str) -> tuple[str, str]:
    """The text, and the comments at its end, which stay at the end when lines are added before them."""
    start = _REMARKS.search(text)
    return (text, "") if start is None or not start[1] else (text[: start.start(1)], text[start.start(1) :])


def _holds(text: str, wanted: Any) -> bool:
    """Whether a text is read as these values."""
    try:
        return bool(parse(text, "").data == wanted)
    except ConfigurationError:
        return False


def _put(data: Any, place: Place, value: Any, made: Any, insert: Any = None) -> None:
    """Set or remove a value; mappings on the way to it are made. made : turns a value into one of the tree"""
    for part in place[:-1]:
        if isinstance(data, dict) and not isinstance(data.get(part), dict | list):
            _set(data, part, made({}), insert)
        data = data[part]
    if value is not REMOVED:
        _set(data, place[-1], made(value), insert)
    elif isinstance(data, dict):
        data.pop(place[-1], None)
    else:
        del data[place[-1]]


def _set(data: Any, part: Any, value: Any, insert: Any) -> None:
    if insert is not None and isinstance(value, list) and len(value) > _MOST_ON_A_LINE:
        _take_lines(data, value)
    if insert is not None and isinstance(data, dict) and part not in data:
        insert(data, part, value)
    else:
        data[part] = value


def _take_lines(data: Any, value: Any) -> None:
    """Let a long list of names have a line for each, in a mapping that has a line for each key."""
    if all(isinstance(one, str) for one in value):
        value.fa.set_block_style()
        data.fa.set_block_style()


def _styled(value: Any) -> Any:
    """A value for the tree, its lists and mappings on one line, its text quoted where it must be."""
    from ruamel.yaml.comments import CommentedMap, CommentedSeq
    from ruamel.yaml.scalarstring import DoubleQuotedScalarString

    if isinstance(value, dict | list | tuple):
        made: Any = CommentedMap() if isinstance(value, dict) else CommentedSeq()
        made.fa.set_flow_style()
        if isinstance(value, dict):
            made.update({key: _styled(item) for key, item in value.items()})
        else:
            made.extend(_styled(item) for item in value)
        return made
    if isinstance(value, str) and not _is_plain(value):
        return DoubleQuotedScalarString(value)
    return value


def _is_plain(text: str) -> bool:
    """Whether a text is read back as itself without quotes, in a list too."""
    if not re.fullmatch(r"[A-Za-z0-9_][\w. /+-]*", text) or text != text.strip():
        return False
    return bool(parse_value(text) == text)


def _insert(data: Any, part: Any, value: Any) -> None:
    """A new key where no comment between others comes to stand before it: a stage before the last one, a parameter
    behind the first where a comment behind the last one belongs to what follows. A new section has a line per key."""
    if "stages" in data and (style := getattr(value, "fa", None)) is not None:
        style.set_block_style()
    if data.fa.flow_style() or len(data) < 2 or "stages" in data:
        data[part] = value
    elif isinstance(value, dict) and "stage" in value:
        data.insert(len(data) - 1, part, value)
    else:
        data.insert(len(data) if _ends_plainly(data) else 1, part, value)


def _ends_plainly(data: Any) -> bool:
    """Whether the last value of a mapping is on its key's line, without lines of comment behind it."""
    last = next(reversed(data))
    behind = (data.ca.items.get(last) or [None] * 3)[2]
    return not isinstance(data[last], dict | list) and (behind is None or "#" not in behind.value.partition("\n")[2])


def _without_marker(parts: set[Any], found: re.Match[str]) -> str:
    """A line without its reminder, once its value is given."""
    key, _, value = found[1].partition(":")
    return found[1] if key.strip() in parts and value.strip() else found[0]


def _loaded(yaml: Any, text: str) -> Any:
    from ruamel.yaml.error import YAMLError

    try:
        return yaml.load(text)
    except (YAMLError, ValueError) as error:
        raise ConfigurationError(f"this file cannot be edited here ({error}); edit it in an editor") from error


def _dumped(yaml: Any, tree: Any) -> str:
    stream = io.StringIO()
    yaml.dump(tree, stream)
    return stream.getvalue()


def _yaml(text: str) -> Any:
    """What reads and writes a file with the indentation that its text has."""
    from ruamel.yaml import YAML

    found = _INDENTED.search(text)
    side = len(found[1]) if found else 2
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 100_000
    yaml.indent(mapping=side, sequence=side + 2, offset=side)
    return yaml


def _only_changed(text: str, before: str, after: str) -> str:
    """The text with the lines that differ between two others, as far as the first has the lines of ``before``."""
    lines, old, new = (one.splitlines(keepends=True) for one in (text, before, after))
    if len(lines) != len(old):
        return after
    merged: list[str] = []
    for tag, i1, i2, j1, j2 in difflib.SequenceMatcher(None, old, new, autojunk=False).get_opcodes():
        merged += lines[i1:i2] if tag == "equal" else new[j1:j2]
    return "".join(merged)
