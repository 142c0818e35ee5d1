"""YAML from unknown sources: composed within limits, and with a remedy in every message.

Nothing is constructed here: the nodes are read by others. All limits are checked while the text is scanned, before
anything is composed.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import Any

import yaml

from dicflow.errors import DicflowError
from dicflow.io.text import find_control, place_in, printable

__all__ = ["MAX_DEPTH", "MAX_NODES", "TOO_DEEP", "compose", "position"]

MAX_NODES = 50_000
MAX_DEPTH = 50
_MAX_CHARACTERS = 10_000
TOO_DEEP = f"more than {MAX_DEPTH} lists or mappings inside each other"
_ODD_SPACES = re.compile("[\u00a0\u2007\u202f\u3000]+")
"""Spaces of typesetting."""
_QUOTES = tuple("“”„‟«»‘’‚‛‹›")
_ESCAPE = re.compile(r'\\(?:[\\"/xuU\n]|(.))')
"""A back-slash and what it stands before; the group takes part for what few people mean in a name."""
_REMEDIES = (
    ("unknown escape|hexdecimal", "write / between folders, or put the text in single quotes"),
    ("expected ',' or", "close the bracket, and separate values by commas"),
    ("anchor|alias", "put text that begins with * or & in quotes"),
    ("cannot start any token", "put text that begins with @, `, % or a tab in quotes"),
    ("mapping values are not allowed", "check the indentation, and put text that holds ': ' in quotes"),
    ("expected ':'", "write 'name: value', indented as the line above"),
    ("end of stream", "close the quote"),
    ("document", "leave only one document, without --- and ..."),
)
_REMEDY = "check indentation, brackets and quotes there"


def compose(
    text: str,
    source: str,
    raised: type[DicflowError],
    tags: Collection[str] = (),
    *,
    aliases: bool = True,
    most_nodes: int = MAX_NODES,
) -> yaml.Node | None:
    """The node at the top of a text; None for an empty one.

    source : its name in messages
    tags, aliases : tags that values may have, and whether they may be aliases of others
    most_nodes : values that are read; each takes about 5 µs and 0.4 kB
    Raises an error of the class ``raised`` with line and column.
    """
    _refuse_control(text, source, raised)
    text = _with_plain_spaces(text)
    try:
        for event in _scanned(text, source, raised, most_nodes):
            _refuse_event(event, source, raised, tags, aliases)
        root = yaml.compose(text, Loader=yaml.CSafeLoader)
    except yaml.MarkedYAMLError as error:
        raise _explained(text, source, error, raised) from error
    except (yaml.YAMLError, UnicodeError) as error:
        raise raised(source, f"not valid YAML: {printable(error)}", _REMEDY) from error
    if root is not None:
        _refuse_habits(root, text, source, raised)
    return root


def position(source: str, node: Any) -> str:
    """``file:line:column`` of a node or an event."""
    return f"{source}:{node.start_mark.line + 1}:{node.start_mark.column + 1}"


def _with_plain_spaces(text: str) -> str:
    """Text with spaces of typesetting made plain at both ends of lines and beside YAML's signs, and nowhere else."""

    def plain(found: re.Match[str]) -> str:
        before, after = text[max(found.start() - 1, 0) : found.start()], text[found.end() : found.end() + 1]
        return " " * len(found[0]) if before in "\n\t :,[{-" or after in "\n\t :,]}#" else found[0]

    return _ODD_SPACES.sub(plain, text)


def _scanned(text: str, source: str, raised: type[DicflowError], most_nodes: int) -> Iterator[yaml.Event]:
    """What a text consists of, up to the limits of depth and number."""
    depth = count = 0
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        count += isinstance(event, yaml.NodeEvent)
        if depth > MAX_DEPTH:
            raise raised(position(source, event), TOO_DEEP, "remove some")
        if count > most_nodes:
            raise raised(position(source, event), f"more than {most_nodes:,} values", "write fewer")
        yield event


def _refuse_event(
    event: yaml.Event, source: str, raised: type[DicflowError], tags: Collection[str], aliases: bool
) -> None:
    if isinstance(event, yaml.AliasEvent) and not aliases:
        raise raised(position(source, event), "an alias is not allowed", "write the value out")
    if (tag := getattr(event, "tag", None)) is not None and tag not in tags:
        raise raised(position(source, event), f"the tag {printable(tag)} is not allowed", "write plain values")
    if isinstance(event, yaml.ScalarEvent) and len(event.value) > _MAX_CHARACTERS:
        problem = f"text of {len(event.value):,} characters, at most {_MAX_CHARACTERS:,} are read"
        raise raised(position(source, event), problem, "shorten it")


def _refuse_control(text: str, source: str, raised: type[DicflowError]) -> None:
    if (index := find_control(text)) is not None:
        line, column = place_in(text, index)
        problem = f"holds the control character U+{ord(text[index]):04X}"
        raise raised(f"{source}:{line}:{column}", problem, "delete it")


def _refuse_habits(root: yaml.Node, text: str, source: str, raised: type[DicflowError]) -> None:
    """Refuse text that YAML reads otherwise than it looks: typographic quotes, back-slashes in double quotes."""
    for node in _scalars(root):
        if not node.style and node.value.startswith(_QUOTES):
            raise raised(position(source, node), f"typographic quotes, {printable(node.value)}", "write straight ones")
        if letter := _escaped(text, node):
            problem = f"\\{letter} in double quotes is a special character"
            raise raised(position(source, node), problem, _REMEDIES[0][1])
        if find_control(node.value) is not None or "\r" in node.value:
            raise raised(position(source, node), f"control characters, {printable(node.value)}", "leave them out")


def _escaped(text: str, node: yaml.ScalarNode) -> str:
    """The first letter after a back-slash by which double quotes make a special character; "" without one."""
    if node.style != '"':
        return ""
    found = _ESCAPE.finditer(text, node.start_mark.index, node.end_mark.index)
    return next((escape[1] for escape in found if escape[1]), "")


def _scalars(root: yaml.Node) -> Iterator[yaml.ScalarNode]:
    """All scalars, each once, however often aliases refer to it."""
    waiting, seen = [root], {id(root)}
    while waiting:
        node = waiting.pop()
        if isinstance(node, yaml.ScalarNode):
            yield node
            continue
        parts = [part for pair in node.value for part in pair] if isinstance(node, yaml.MappingNode) else node.value
        new = [part for part in parts if id(part) not in seen]
        seen |= {id(part) for part in new}
        waiting += new


def _explained(text: str, source: str, error: yaml.MarkedYAMLError, raised: type[DicflowError]) -> DicflowError:
    problem = f"{error.context or ''} {error.problem or ''}".strip()
    marks = [error.problem_mark, error.context_mark]
    mark = next(filter(None, reversed(marks) if "end of stream" in problem else marks), None)
    if "flow" in problem and mark is not None and error.context_mark and error.context_mark.line < mark.line:
        mark = error.context_mark  # the bracket that is not closed
    if mark is None:
        return raised(source, f"not valid YAML: {problem}", _REMEDY)
    lines = text.split("\n")
    for number in (mark.line, mark.line + 1, mark.line - 1):
        indentation = re.match(r"\s*", lines[number])[0] if 0 <= number < len(lines) else ""  # type: ignore[index]
        if "\t" in indentation:
            where = f"{source}:{number + 1}:{indentation.index(chr(9)) + 1}"
            return raised(where, "not valid YAML: a tab in the indentation", "indent with spaces")
    remedy = next((remedy for pattern, remedy in _REMEDIES if re.search(pattern, problem)), _REMEDY)
    return raised(f"{source}:{mark.line + 1}:{mark.column + 1}", f"not valid YAML: {problem}", remedy)
