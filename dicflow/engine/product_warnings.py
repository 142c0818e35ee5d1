"""What a run ends with: warnings of products, and why tasks failed, each sentence once with the steps it is of."""

from __future__ import annotations

from collections.abc import Mapping

from dicflow.engine.graph import Graph
from dicflow.engine.work import Outcome

__all__ = ["failures", "product_warnings"]


def product_warnings(graph: Graph, outcomes: Mapping[str, Outcome]) -> list[tuple[str, str]]:
    """Stage and sentence, in the order of the graph.

    A sentence that a product shares with an input of the same step is that input's.
    """
    found: dict[tuple[str, str], list[str | None]] = {}
    for name, outcome in outcomes.items():
        for text in outcome.warnings:
            if text not in _inherited(graph, name, outcomes):
                found.setdefault((outcome.stage, text), []).append(outcome.step)
    return [(stage, f"{_place(graph, stage, steps)}: {text}") for (stage, text), steps in found.items()]


def failures(graph: Graph, outcomes: Mapping[str, Outcome]) -> list[str]:
    """Stage, steps and message of the tasks that failed, in the order of the graph."""
    found: dict[tuple[str, str], list[str | None]] = {}
    for name, outcome in outcomes.items():
        if outcome.status == "failed":
            found.setdefault((outcome.stage, outcome.error.removeprefix(f"{name}: ")), []).append(outcome.step)
    return [f"{_place(graph, stage, steps)}: {text}" for (stage, text), steps in found.items()]


def _inherited(graph: Graph, name: str, outcomes: Mapping[str, Outcome]) -> set[str]:
    task = graph.tasks[name]
    producers = (outcomes[producer] for producer in task.producers() if producer in outcomes)
    return {text for one in producers if one.stage != task.stage and one.step == task.step for text in one.warnings}


def _place(graph: Graph, stage: str, steps: list[str | None]) -> str:
    """The stage, with its step, or with the number of its steps and the first and last."""
    if steps == [None] or not graph.steps[stage]:
        return stage
    if len(steps) == 1:
        return f"{stage}/{steps[0]}"
    return f"{stage} at {len(steps)} of {len(graph.steps[stage])} steps, {steps[0]} … {steps[-1]}"
