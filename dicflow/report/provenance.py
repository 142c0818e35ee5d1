"""Section: what was computed and what came from the store, when, how long it took and by which code."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

import yaml
from markupsafe import Markup

from dicflow.engine.records import versions
from dicflow.pipeline.provenance import RunFacts
from dicflow.report.context import Context, Section
from dicflow.report.rendering import render
from dicflow.report.words import date, duration
from dicflow.views.graph import Mark, graph_svg

__all__ = ["PLACE", "TITLE", "provenance"]

PLACE = 60
TITLE = "Provenance"

_ADDRESS = ' xmlns="http://www.w3.org/2000/svg"'


class StageFacts(NamedTuple):
    """Outcome of the tasks of one stage.

    counts : status → number of tasks
    spent, saved : time in tasks that ran, and that those at hand once took [s]
    """

    counts: Mapping[str, int]
    spent: float
    saved: float

    @property
    def status(self) -> str:
        """The worst outcome of a task; computed rather than hit if both occur."""
        return next((name for name in ("failed", "skipped", "computed", "hit") if self.counts.get(name)), "missing")


def provenance(context: Context) -> Section:
    """The section; of a pipeline that was never run only its graph, settings and the versions here."""
    run, graph = context.run, context.result.graph
    facts = {stage: _stage(run, stage) for stage in graph.stages}
    unlike = _unlike(run)
    warnings = () if not unlike else (f"Products were made by another version of {', '.join(unlike)} than is here.",)
    body = render(
        "provenance.html",
        run=run,
        started=date(run.started) if run is not None else "",
        saved=duration(run.saved_s) if run is not None else "",
        spent=duration(sum(stage.spent for stage in facts.values())),
        picture=_picture(context, facts),
        stages=[
            (
                name,
                graph.stages[name].node.title,
                len(graph.tasks_of(name)),
                one,
                _time(one.spent),
                _time(one.saved),
            )
            for name, one in facts.items()
        ],
        versions=_versions(run),
        tasks=run.tasks if run is not None else (),
        duration=duration,
        settings=context.without_local_paths(
            yaml.safe_dump(context.pipeline.resolved(), sort_keys=False, allow_unicode=True)
        ),
    )
    return Section("provenance", TITLE, body, warnings)


def _stage(run: RunFacts | None, stage: str) -> StageFacts:
    tasks = [task for task in run.tasks if task.stage == stage] if run is not None else []
    spent = sum(task.seconds for task in tasks if task.status != "hit")
    return StageFacts(Counter(task.status for task in tasks), spent, sum(task.seconds for task in tasks) - spent)


def _time(seconds: float) -> str:
    return duration(seconds) if seconds else "–"


def _picture(context: Context, facts: Mapping[str, StageFacts]) -> Markup:
    """The graph with the status of each stage, as an element of the page."""
    run = context.run
    marks = {
        name: Mark(one.status, _note(one)) if run is not None else _held(context, name) for name, one in facts.items()
    }
    return Markup(graph_svg(context.result.graph, marks).replace(_ADDRESS, "", 1))


def _held(context: Context, instance: str) -> Mark:
    """How many products of a stage the store holds, for a pipeline without a run."""
    result = context.result
    variant, stage = next(
        (number, stage)
        for number, names in enumerate(context.pipeline.instances)
        for stage, name in names.items()
        if name == instance
    )
    steps = result.steps(stage) or (None,)
    count = sum(result.has(stage, step, variant) for step in steps)
    return Mark("hit" if count == len(steps) else "missing", f"{count} in the store")


def _note(facts: StageFacts) -> str:
    counts = ", ".join(f"{count} {status}" for status, count in sorted(facts.counts.items()))
    if not counts:
        return "nothing known"
    return f"{counts} · {duration(facts.spent)}" if facts.spent else counts


def _versions(run: RunFacts | None) -> list[tuple[str, str, str]]:
    """Package, versions that made the products, version here."""
    here, made = versions(), run.versions if run is not None else {}
    names = sorted({*here, *made}, key=lambda name: (name not in ("dicflow", "python"), name))
    return [(name, ", ".join(made.get(name, ())) or "–", here.get(name, "–")) for name in names]


def _unlike(run: RunFacts | None) -> list[str]:
    """Packages whose installed version is not the one that made a product."""
    here = versions()
    found = run.versions.items() if run is not None else ()
    return [name for name, made in found if name in here and set(made) != {here[name]}]
