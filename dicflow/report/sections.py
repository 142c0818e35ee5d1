"""The sections of the page, found in :mod:`dicflow.report` and in the packages of others."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

from dicflow.discovery import Registry
from dicflow.errors import ConfigurationError
from dicflow.report.context import Builder, Context, Section

__all__ = ["SECTIONS", "Entry", "entries"]

SECTIONS = Registry("report section", "dicflow.report", "dicflow.report_sections", ("PLACE", "TITLE"))


class Entry(NamedTuple):
    """A section before it is made.

    key : its name
    is_plugin : whether another package makes it
    """

    key: str
    title: str
    build: Builder
    is_plugin: bool = False


def entries() -> list[Entry]:
    """All sections but the summary, in order; a plug-in that cannot be used shows its error at the end."""
    placed = [_placed(name) for name in SECTIONS.names()]
    return [entry for _, entry in sorted(placed, key=lambda pair: (pair[0], pair[1].key))]


def _placed(name: str) -> tuple[float, Entry]:
    try:
        module, is_plugin = SECTIONS.load(name), SECTIONS.find(name).is_plugin
        if not hasattr(module, name):
            raise ConfigurationError(f"the report section of {SECTIONS.find(name).place} needs a function '{name}'")
        return module.PLACE, Entry(name, module.TITLE, getattr(module, name), is_plugin)
    except ConfigurationError as error:
        return float("inf"), Entry(name, name.capitalize(), partial(_refuse, error), is_plugin=True)


def _refuse(error: Exception, context: Context) -> Section | None:
    raise error
