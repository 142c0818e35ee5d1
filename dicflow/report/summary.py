"""Section: results and warnings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence

from markupsafe import Markup

from dicflow.pipeline.provenance import RunFacts
from dicflow.report.context import Context, Section
from dicflow.report.history import EXTENSOMETERS, Column, History, step_history
from dicflow.report.rendering import render
from dicflow.report.rest import at_rest
from dicflow.report.words import date, duration, least_percent, number, percent

__all__ = ["summary"]

_FEW = 0.9
_FAILURES_SHOWN = 20
_PEAKS = ("dic_displacement_mm", "dic_strain", "mean_V_mm", "mean_V_px", "mean_eyy")


def summary(context: Context, sections: Sequence[Section]) -> Section:
    """The first section, which shows the warnings of all others."""
    history = step_history(context)
    own = [] if history is None else _lost_points(history)
    warnings = [(section.title, section.key, text) for section in sections for text in section.warnings]
    covered = {stage for section in sections for stage in section.covers}
    unlinked = (*_notes(context), *_run_warnings(context, covered), *own)
    run, failures, rest = context.run, _failures(context), at_rest(context.result, context.piece)
    body = render(
        "summary.html",
        state=_state(run),
        known=run is not None,
        failures=failures[:_FAILURES_SHOWN],
        more_failures=max(0, len(failures) - _FAILURES_SHOWN),
        skipped=_skipped(run),
        warnings=[*(("", "", text) for text in unlinked), *warnings],
        facts=_facts(context, history),
        history=history if history is not None and (history.values or any(history.valid_share)) else None,
        columns=None if history is None else _columns(history),
        rows=None if history is None else _rows(history),
        chart=None if history is None else _chart(context, history),
        stages=_stages(context),
        at_rest=rest.probes if rest is not None and history is not None and history.source == EXTENSOMETERS else (),
    )
    return Section("summary", "Summary", body, unlinked)


def _state(run: RunFacts | None) -> list[str]:
    """Problems of the run as a whole, in sentences; empty if it succeeded."""
    if run is None:
        return ["No run of this pipeline as it stands is known: shown is what the store holds of it."]
    counts, missing = run.counts, max(0, run.planned - len(run.tasks))
    sentences = []
    if counts["failed"]:
        sentences.append(
            f"{counts['failed']} of {run.planned} tasks failed, and {counts['skipped']} were skipped for it."
        )
    if run.interrupted:
        sentences.append(f"The run was interrupted before {missing} of its {run.planned} tasks were done.")
    elif not run.ended:
        sentences.append(
            f"The run was cut off, or goes on still: of {missing} of its {run.planned} tasks nothing is known."
        )
    return sentences


def _failures(context: Context) -> list[tuple[str, str]]:
    """Each failed task and why."""
    tasks = context.run.tasks if context.run is not None else ()
    failed = [task for task in tasks if task.status == "failed"]
    return [(task.task, context.without_local_paths(task.error).removeprefix(f"{task.task}: ")) for task in failed]


def _skipped(run: RunFacts | None) -> list[tuple[str, int]]:
    """Stages with skipped tasks, and how many."""
    tasks = run.tasks if run is not None else ()
    return list(Counter(task.stage for task in tasks if task.status == "skipped").items())


def _notes(context: Context) -> list[str]:
    """Where the products come from, if it matters."""
    return [context.without_local_paths(text) for text in context.result.notes]


def _run_warnings(context: Context, covered: Collection[str]) -> list[str]:
    """The warnings of the run. covered : stages whose warnings other sections have"""
    found = context.run.warnings if context.run is not None else ()
    return [context.without_local_paths(one.text) for one in found if one.stage not in covered]


def _lost_points(history: History) -> list[str]:
    """A warning if steps lack many points."""
    few = [
        (step, share)
        for step, share in zip(history.steps, history.valid_share, strict=True)
        if share is not None and share < _FEW
    ]
    if not few:
        return []
    worst, share = min(few, key=lambda pair: pair[1])
    steps = "1 step has" if len(few) == 1 else f"{len(few)} steps have"
    return [f"{steps} a value at less than {percent(_FEW)} of the points, {worst} at {percent(share)} only."]


def _facts(context: Context, history: History | None) -> list[tuple[str, str, str]]:
    """Title, value and remark of the key figures."""
    result, run = context.result, context.run
    facts = []
    if history is not None:
        facts.append(("Steps", str(len(history.steps)), f"{history.steps[0]} … {history.steps[-1]}"))
        shares = [share for share in history.valid_share if share is not None]
        if shares:
            facts.append(("Points with a value", least_percent(min(shares)), "least of all steps"))
    if len(result.values) > 1:
        facts.append(("Variants", str(len(result.values)), "below is the first; see Variants of the sweep"))
    facts += (
        [_peak(history, column) for column in history.columns if column.key in _PEAKS] if history is not None else []
    )
    if run is not None:
        counts = run.counts
        spent = sum(task.seconds for task in run.tasks if task.status != "hit")
        facts.append(("Run", date(run.started), f"{counts['computed']} tasks computed, {counts['hit']} from the store"))
        facts.append(("Time in stages", duration(spent), f"{duration(run.saved_s)} saved by the store"))
    return facts


def _peak(history: History, column: Column) -> tuple[str, str, str]:
    """The largest value of a column, and at which step it stands."""
    known = [
        (abs(value), value, step)
        for value, step in zip(history.values[column.key], history.steps, strict=False)
        if value is not None
    ]
    if not known:
        return (f"Largest {column.title}", "–", "nothing measured")
    _size, value, step = max(known)
    unit = "" if column.unit == "1" else f" {column.unit}"
    return (f"Largest {column.title}", f"{number(value)}{unit}", f"at {step}")


def _columns(history: History) -> list[tuple[str, str]]:
    phases = [("phase", "")] if history.phases else []
    titles = [f"{column.title} [{'–' if column.unit == '1' else column.unit}]" for column in history.columns]
    return [("step", ""), *phases, *((title, "number") for title in (*titles, "points with a value"))]


def _rows(history: History) -> list[list[str]]:
    return [
        [
            step,
            *history.phases[index : index + 1],
            *(number(history.values[column.key][index]) for column in history.columns),
            "reference" if index == 0 else least_percent(history.valid_share[index]),
        ]
        for index, step in enumerate(history.steps)
        if all(index < len(values) for values in history.values.values())
    ]


def _chart(context: Context, history: History) -> Markup | None:
    """The plots of the table over load or time, or over the steps."""
    values = {key: history.values[key] for key in (history.axis, *history.drawn) if key in history.values}
    if not values:
        return None
    label = next((f"{column.title} [{column.unit}]" for column in history.columns if column.key == history.axis), "")
    sources = ["history", repr((history.steps, history.phases, values, label))]

    def drawn() -> bytes:
        from dicflow.views.load_curve import Axis, load_curves

        return "\n".join(load_curves(history.steps, history.phases, values, Axis(history.axis, label))).encode()

    return Markup(context.pieces.get(sources, drawn).decode())


def _stages(context: Context) -> list[tuple[str, str]]:
    """How many products of each stage the store holds."""
    result = context.result
    return [
        (stage, f"{sum(result.has(stage, step) for step in steps)} of {len(steps)}")
        for stage in result.stages
        for steps in (result.steps(stage) or (None,),)
    ]
