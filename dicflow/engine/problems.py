"""What stages find wrong in their parameters, and in what is joined to them, before anything runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from dicflow.engine.files import FilePart
from dicflow.engine.graph import Graph
from dicflow.engine.node import Joined
from dicflow.errors import ConfigurationError

__all__ = ["Facts", "check_parameters"]

Facts = Mapping[Path | FilePart, Mapping[str, Any]]
"""File → what ``Node.check`` returned."""


def check_parameters(graph: Graph, facts: Mapping[str, Facts]) -> None:
    """Raise ConfigurationError that lists every parameter that does not suit, with its place.

    facts : stage → file → what the stage found in it
    """
    found: list[str] = []
    for name, joined in _all_joined(graph, facts):
        spec = graph.stages[name]
        for parameter, problem in spec.node.problems(joined):
            where = spec.places.get(parameter, spec.where)
            found.append(f"{where + ': ' if where else ''}{name}.{parameter}: {problem}")
    if found:
        raise ConfigurationError("\n".join(dict.fromkeys(found)))


def _all_joined(graph: Graph, facts: Mapping[str, Facts]) -> Iterator[tuple[str, dict[str, Joined]]]:
    """Each stage with port → the stage joined to it."""
    known: dict[str, Joined] = {}
    for name, spec in graph.stages.items():
        inputs = {port: known[source] for port, source in spec.inputs.items() if source in known}
        first = _first_facts(graph, graph.starts[name], facts) if name in graph.starts else {}
        files = tuple(facts.get(name, ()))
        known[name] = Joined(spec.node, graph.steps[name], first, files, inputs, graph.is_whole)
        yield name, inputs


def _first_facts(graph: Graph, start: str, facts: Mapping[str, Facts]) -> dict[str, Mapping[str, Any]]:
    """Argument → facts of the file of the first step of a series."""
    first = next(iter(graph.files[start].values()), {})
    return {argument: facts[start][file] for argument, file in first.items()}
