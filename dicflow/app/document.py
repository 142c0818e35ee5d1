"""The pipeline file as the app edits it: by place, with comments, order and style kept."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from dicflow.app.project import Project
from dicflow.app.versions import MISSING, change, digest_of
from dicflow.errors import ConfigurationError
from dicflow.io.configuration import MAX_BYTES, parse, parse_value
from dicflow.io.edited_yaml import REMOVED, Edit, edited
from dicflow.io.text import read_text
from dicflow.pipeline.sweep import variants
from dicflow.pipeline.wiring import wire

__all__ = ["Text", "edit", "edits_of", "problems", "read_pipeline"]


class Text(NamedTuple):
    """A file's text and the digest of its bytes."""

    text: str
    digest: str


def read_pipeline(project: Project, name: str) -> Text:
    """The text of a pipeline file. Raises InputError if it cannot be read."""
    path = project.path(name)
    digest = digest_of(project, name)
    return Text(read_text(path, "a pipeline file", MAX_BYTES) if digest != MISSING else "", digest)


def problems(text: str, source: str) -> list[str]:
    """What the command line would say of a pipeline file with this text; nothing of a valid one."""
    try:
        for variant in variants(parse(text, source)):
            wire(variant.document)
    except ConfigurationError as error:
        return str(error).splitlines()
    return []


def edits_of(asked: Sequence[Mapping[str, Any]]) -> list[Edit]:
    """Edits as a page sends them: ``place``, and ``value``, or ``text`` as a person writes it in the file.

    Neither of the two, or an empty text, takes the key away.
    """
    return [Edit(tuple(one["place"]), _value(one)) for one in asked]


def _value(one: Mapping[str, Any]) -> Any:
    if "value" in one:
        return one["value"]
    text = str(one.get("text", "")).strip()
    return parse_value(text) if text else REMOVED


def edit(project: Project, name: str, seen: str, edits: Sequence[Edit], words: str) -> list[str]:
    """Write edits to a pipeline file; returns what is still wrong with it.

    seen : digest of the file as the page has it
    Raises ConfigurationError, in the words of the command line, if the edits make a valid file invalid, and Conflict if
    the file has changed meanwhile; nothing is written then.
    """
    found = read_pipeline(project, name)
    source = str(project.path(name))
    text = edited(found.text, source, edits)
    left = problems(text, source)
    if left and not problems(found.text, source):
        raise ConfigurationError("\n".join(left))
    change(project, {name: seen}, {name: text.encode()}, words)
    return left
