"""YAML 1.2 with the position of every value."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from dicflow.errors import ConfigurationError

__all__ = ["Document", "Place", "parse", "parse_value", "read"]

Place = tuple[str | int, ...]
"""Keys and indices that lead from the top of a document to a value."""

_MAX_NODES = 100_000
_MAX_DEPTH = 50
_MAX_DIGITS = 100
_TOO_DEEP = f"more than {_MAX_DEPTH} lists or mappings inside each other; remove some"
_QUOTED = ("'", '"', "|", ">")
_SCALARS: tuple[tuple[re.Pattern[str], Any], ...] = (
    (re.compile(r"~|null|Null|NULL|"), lambda text: None),
    (re.compile(r"true|True|TRUE"), lambda text: True),
    (re.compile(r"false|False|FALSE"), lambda text: False),
    (re.compile(r"[-+]?[0-9]+"), int),
    (re.compile(r"0o[0-7]+"), lambda text: int(text[2:], 8)),
    (re.compile(r"0x[0-9a-fA-F]+"), lambda text: int(text[2:], 16)),
    (re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?"), float),
    (re.compile(r"[-+]?\.(inf|Inf|INF)"), lambda text: float(text.replace(".", ""))),
    (re.compile(r"\.(nan|NaN|NAN)"), lambda text: float("nan")),
)


class Document(NamedTuple):
    """A parsed file.

    source : its name, as messages show it
    data : mapping of plain Python values
    positions : (line, column), counted from 1, of every key and list element by its place
    given : place → origin of a value that does not come from the file, as messages show it: the command line, a sweep
    """

    source: str
    data: dict[str, Any]
    positions: dict[Place, tuple[int, int]]
    given: Mapping[Place, str] = {}

    def where(self, place: Place) -> str:
        """``file:line:column`` of a place, or of the innermost place around it that the file has."""
        while place and not self.holds(place):
            place = place[:-1]
        if place in self.given:
            return self.given[place]
        line, column = self.positions.get(place, (1, 1))
        return f"{self.source}:{line}:{column}"

    def holds(self, place: Place) -> bool:
        """Whether a value comes from the file, the command line or a sweep."""
        return place in self.positions or place in self.given


def read(path: Path) -> Document:
    """Parse a pipeline file. Raises ConfigurationError with the place if it is missing or not YAML."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigurationError(f"{path}: {reason}; name a pipeline file, or make one with 'dicflow init'") from error
    return parse(text, str(path))


def parse(text: str, source: str) -> Document:
    """Parse YAML text whose top is a mapping.

    Plain scalars follow YAML 1.2's core schema (``1e-3`` is a number, ``on`` is text); duplicate keys and tags
    are refused, so no text can construct an object.
    """
    try:
        _refuse_deep(text, source)
        root = yaml.compose(text, Loader=yaml.CSafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
        raise ConfigurationError(f"{source}{place}: not valid YAML: {error.problem}") from error
    except yaml.YAMLError as error:
        raise ConfigurationError(f"{source}: not valid YAML: {error}") from error
    if not isinstance(root, yaml.MappingNode):
        raise ConfigurationError(f"{source}:1:1: expected a mapping with 'stages:' at the top, found {_kind(root)}")
    reader = _Reader(source)
    return Document(source, reader.value(root, ()), reader.positions)


def parse_value(text: str) -> Any:
    """One value as it would be read from a file: ``3``, ``[1, 2]``, ``2 cm``."""
    return parse(f"value: {text}", "command line").data["value"]


class _Reader:
    """Turns composed nodes into values and records their positions."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.positions: dict[Place, tuple[int, int]] = {}
        self._open: set[int] = set()

    def value(self, node: yaml.Node, place: Place) -> Any:
        self._guard(node, place)
        self.positions.setdefault(place, self._position(node))
        if isinstance(node, yaml.ScalarNode):
            return self._scalar(node)
        self._open.add(id(node))
        try:
            if isinstance(node, yaml.MappingNode):
                return {key: self.value(item, (*place, key)) for key, item in self._items(node, place)}
            return [self.value(item, (*place, index)) for index, item in enumerate(node.value)]
        finally:
            self._open.discard(id(node))

    def _items(self, node: yaml.MappingNode, place: Place) -> Iterator[tuple[str, yaml.Node]]:
        seen: dict[str, int] = {}
        for key_node, item in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                self._fail(key_node, "a key must be a word")
            key = key_node.value
            if key in seen:
                self._fail(key_node, f"key '{key}' is given twice, first in line {seen[key]}; keep one")
            seen[key] = key_node.start_mark.line + 1
            self.positions[(*place, key)] = self._position(key_node)
            yield key, item

    def _scalar(self, node: yaml.ScalarNode) -> Any:
        if node.style in _QUOTED:
            return node.value
        for pattern, convert in _SCALARS:
            if pattern.fullmatch(node.value):
                if len(node.value) > _MAX_DIGITS:
                    self._fail(node, f"a number of {len(node.value)} digits; write {_MAX_DIGITS} at most")
                return convert(node.value)
        return node.value

    def _guard(self, node: yaml.Node, place: Place) -> None:
        if id(node) in self._open:
            self._fail(node, "an alias refers to a value that contains it")
        if len(place) > _MAX_DEPTH:
            self._fail(node, _TOO_DEEP)
        if len(self.positions) > _MAX_NODES:
            self._fail(node, f"more than {_MAX_NODES} values; aliases may have multiplied them")
        if not node.tag.startswith("tag:yaml.org,2002:") or node.tag.startswith("tag:yaml.org,2002:python"):
            self._fail(node, f"the tag {node.tag} is not allowed; write plain values")

    def _position(self, node: yaml.Node) -> tuple[int, int]:
        return node.start_mark.line + 1, node.start_mark.column + 1

    def _fail(self, node: yaml.Node, message: str) -> None:
        line, column = self._position(node)
        raise ConfigurationError(f"{self.source}:{line}:{column}: {message}")


def _refuse_deep(text: str, source: str) -> None:
    """Refuse text that is nested too deeply, before it is composed: each level takes stack."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _MAX_DEPTH:
            place = f":{mark.line + 1}:{mark.column + 1}" if (mark := event.start_mark) else ""
            raise ConfigurationError(f"{source}{place}: {_TOO_DEEP}")


def _kind(node: yaml.Node | None) -> str:
    if node is None:
        return "an empty file"
    return "a list" if isinstance(node, yaml.SequenceNode) else "a single value"
