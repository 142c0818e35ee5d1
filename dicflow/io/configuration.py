"""YAML 1.2 with the position of every value."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import yaml

from dicflow.errors import ConfigurationError, InputError
from dicflow.io.text import printable, read_text
from dicflow.io.yaml_text import MAX_DEPTH, MAX_NODES, TOO_DEEP, compose, position

__all__ = ["MAX_BYTES", "Document", "Place", "parse", "parse_value", "read"]

Place = tuple[str | int, ...]
"""Keys and indices that lead from the top of a document to a value."""

MAX_BYTES = 2_000_000
_MAX_DIGITS = 100
_MOST_NAMED = 3
_LARGEST = 2**63
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
        if place in self.given:
            return True
        return place in self.positions and not any(place[:length] in self.given for length in range(1, len(place)))


def read(path: Path) -> Document:
    """Parse a pipeline file. Raises ConfigurationError with the place if it is missing or not YAML."""
    try:
        text = read_text(path, "a pipeline file", MAX_BYTES)
    except InputError as error:
        where, problem, remedy = error.args
        if isinstance(error.__cause__, OSError):
            remedy = "name a pipeline file, or make one with 'dicflow init'"
        if beside := _pipelines_in(path if path.is_dir() else path.parent):
            remedy += f"; the folder has {beside}"
        raise ConfigurationError(where, problem, remedy) from error
    return parse(text, str(path))


def _pipelines_in(folder: Path) -> str:
    """The YAML files of a folder, in a sentence; "" without one, or if the folder cannot be read."""
    try:
        found = sorted(path for path in folder.iterdir() if path.suffix in (".yaml", ".yml") and path.is_file())
    except (OSError, ValueError):
        return ""
    return ", ".join(printable(path, 300) for path in found[:_MOST_NAMED]) + (", …" if len(found) > _MOST_NAMED else "")


def parse(text: str, source: str) -> Document:
    """Parse YAML text whose top is a mapping.

    Plain scalars follow YAML 1.2's core schema (``1e-3`` is a number, ``on`` is text); duplicate keys and tags
    are refused, so no text can construct an object.
    """
    root = compose(text, source, ConfigurationError)
    if not isinstance(root, yaml.MappingNode):
        problem = f"expected a mapping with 'stages:' at the top, found {_kind(root)}"
        raise ConfigurationError(f"{source}:1:1", problem, "write a pipeline file, or make one with 'dicflow init'")
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
                self._fail(key_node, "a key must be a word", "write 'name: value'")
            key = key_node.value
            if not key.isprintable():
                problem = f"key '{printable(key)}' holds a tab or another special character"
                self._fail(key_node, problem, "write it with plain characters")
            if key in seen:
                problem = f"key '{printable(key)}' is given twice, first in line {seen[key]}"
                self._fail(key_node, problem, "keep one")
            seen[key] = key_node.start_mark.line + 1
            self.positions[(*place, key)] = self._position(key_node)
            yield key, item

    def _scalar(self, node: yaml.ScalarNode) -> Any:
        if node.style in _QUOTED:
            return node.value
        for pattern, convert in _SCALARS:
            if pattern.fullmatch(node.value):
                if len(node.value) > _MAX_DIGITS:
                    self._fail(node, f"a number of {len(node.value)} digits", f"write {_MAX_DIGITS} at most")
                value = convert(node.value)
                if isinstance(value, int) and abs(value) > _LARGEST:
                    self._fail(node, f"a whole number beyond {_LARGEST:.0e}", "write a smaller one")
                return value
        return node.value

    def _guard(self, node: yaml.Node, place: Place) -> None:
        if id(node) in self._open:
            self._fail(node, "an alias refers to a value that contains it", "write the value out")
        if len(place) > MAX_DEPTH:
            self._fail(node, TOO_DEEP, "remove some")
        if len(self.positions) > MAX_NODES:
            self._fail(node, f"more than {MAX_NODES:,} values, aliases may have multiplied them", "write fewer")

    def _position(self, node: yaml.Node) -> tuple[int, int]:
        return node.start_mark.line + 1, node.start_mark.column + 1

    def _fail(self, node: yaml.Node, problem: str, remedy: str) -> NoReturn:
        raise ConfigurationError(position(self.source, node), problem, remedy)


def _kind(node: yaml.Node | None) -> str:
    if node is None:
        return "an empty file"
    return "a list" if isinstance(node, yaml.SequenceNode) else "a single value"
