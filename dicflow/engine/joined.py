"""What is known of the stages joined to another one before anything runs: settings, and facts about their files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from dicflow.engine.files import FilePart
from dicflow.engine.graph import Graph
from dicflow.engine.node import Node, Steps
from dicflow.errors import InputError

__all__ = ["ChecksJoined", "Joined", "check_joined_files"]

Facts = Mapping[Path | FilePart, Mapping[str, Any]]
"""File → what ``Node.check`` returned."""


@dataclass(frozen=True)
class Joined:
    """A stage joined to an input of another one.

    facts : of its files; steps : of the series that it starts, empty for others; inputs : port → stage joined to it
    """

    node: Node
    facts: Facts
    steps: Steps
    inputs: Mapping[str, Joined]


@runtime_checkable
class ChecksJoined(Protocol):
    """A stage that can be refused for what is joined to it, before anything runs."""

    def check_joined_files(self, joined: Mapping[str, Joined]) -> None:
        """Raise InputError that says what to change. joined : port → stage that gives it"""


def check_joined_files(graph: Graph, facts: Mapping[str, Facts]) -> None:
    """Let stages check what is joined to them. facts : stage → of its files. Raises InputError with the place."""
    for name, joined in _all_joined(graph, facts):
        if not isinstance(joined.node, ChecksJoined):
            continue
        try:
            joined.node.check_joined_files(joined.inputs)
        except InputError as error:
            place = ": ".join(filter(None, (graph.stages[name].where, name)))
            raise InputError(f"{place}: {error}").with_traceback(error.__traceback__) from error


def _all_joined(graph: Graph, facts: Mapping[str, Facts]) -> Iterator[tuple[str, Joined]]:
    found: dict[str, Joined] = {}
    for name, spec in graph.stages.items():
        inputs = {port: found[source] for port, source in spec.inputs.items() if source in found}
        found[name] = Joined(spec.node, facts.get(name, {}), graph.files.get(name, {}), inputs)
        yield name, found[name]
