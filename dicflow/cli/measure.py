"""Commands that compute: run, plan, why."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from dicflow.cli.options import (
    CodePolicy,
    Data,
    Output,
    PipelineFile,
    Policy,
    Settings,
    StoreFolder,
    load,
    results_folder,
    say,
)
from dicflow.engine.cluster_spec import KINDS
from dicflow.engine.journal import STATUSES
from dicflow.engine.schedulers import scheduler_names
from dicflow.errors import ConfigurationError
from dicflow.views.topics import advice, topic_of

if TYPE_CHECKING:
    from rich.console import Console

    from dicflow.engine.journal import Event
    from dicflow.engine.phases import Phases
    from dicflow.pipeline import Pipeline, Result
    from dicflow.views.progress import Progress

__all__ = ["compute_and_write", "plan", "run", "why"]

_MOST_FAILURES = 5
"""Messages of failed tasks that a run repeats in its last lines."""


def run(
    pipeline: PipelineFile,
    settings: Settings,
    data: Data = None,
    store: StoreFolder = None,
    output: Output = None,
    workers: Annotated[
        str, typer.Option(metavar="N or N..M", help="workers at once; default: one per core; of a cluster from N to M")
    ] = str(os.cpu_count() or 1),
    scheduler: Annotated[str, typer.Option(help=scheduler_names())] = "auto",
    cluster: Annotated[
        str, typer.Option(metavar="NAME | FILE", help=f"start workers as jobs: {', '.join(KINDS)}, or a file")
    ] = "",
    dashboard: Annotated[
        bool,
        typer.Option(
            "--dashboard", help="serve dask's dashboard and print its link; everyone on this machine can read it"
        ),
    ] = False,
    wait: Annotated[bool, typer.Option("--wait", help="keep the dashboard until Enter is pressed")] = False,
    keep_going: Annotated[
        bool, typer.Option("--keep-going", help="after a failure go on with all that does not depend on it")
    ] = False,
    code_policy: Policy = CodePolicy.recompute,
    as_json: Annotated[bool, typer.Option("--json", help="end with one line of JSON on standard output")] = False,
    profile: Annotated[bool, typer.Option("--profile", help="end with a table of where the time went")] = False,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="draw no maps")] = False,
    no_report: Annotated[bool, typer.Option("--no-report", help="write no report")] = False,
) -> None:
    """Compute what is missing, then write maps, tables and the report.

    \b
    dicflow run pipeline.yaml
    dicflow run pipeline.yaml --set surface.robust=LAR
    dicflow run pipeline.yaml --set smooth.degree=1,2,3 --workers 4
    dicflow run pipeline.yaml --cluster slurm --workers 2..40
    """
    from dicflow.engine.phases import Phases
    from dicflow.io.files import make_folder

    phases = Phases()
    phases.end("start")
    chosen = _workers(workers, cluster, scheduler)
    loaded = load(pipeline, data, store, settings)
    folder = results_folder(loaded, output)
    assert loaded.graph
    make_folder(folder)
    result, code = compute_and_write(
        loaded,
        folder,
        phases,
        pictures=not no_pictures,
        report=not no_report,
        scheduler=scheduler,
        dashboard=dashboard,
        code_policy=code_policy.value,
        keep_going=keep_going,
        linger=_until_enter if dashboard and wait else None,
        **chosen,
    )
    _end_run(result, phases if profile else None, as_json)
    raise typer.Exit(code)


def plan(
    pipeline: PipelineFile,
    settings: Settings,
    data: Data = None,
    store: StoreFolder = None,
    code_policy: Policy = CodePolicy.recompute,
) -> None:
    """List what a run would compute, and why; nothing is computed.

    \b
    dicflow plan pipeline.yaml
    dicflow plan pipeline.yaml --set smooth.window=[40,20]
    """
    from dicflow.views.console import consoles, plan_table
    from dicflow.views.progress import Progress

    out, progress = consoles()
    with Progress(progress) as shown:
        made = load(pipeline, data, store, settings).plan(code_policy.value, shown.on_event)
    for warning in made.warnings:
        out.print(f"warning: {warning}", style="yellow", soft_wrap=True)
    out.print(plan_table(made))


def why(
    pipeline: PipelineFile,
    stage: Annotated[str, typer.Argument(help="name of a stage, or of one task such as disparity/step_03")],
    settings: Settings,
    data: Data = None,
    store: StoreFolder = None,
) -> None:
    """List what has changed for a stage since it was computed.

    Parameters old → new, inputs, files, code.

    \b
    dicflow why pipeline.yaml strain
    """
    from dicflow.views.console import consoles, why_lines
    from dicflow.views.progress import Progress

    out, progress = consoles()
    with Progress(progress) as shown:
        made = load(pipeline, data, store, settings).plan(on_event=shown.on_event)
    for line in why_lines(made, stage):
        out.print(line, soft_wrap=True)


def _workers(given: str, cluster: str, scheduler: str) -> dict[str, Any]:
    """Options of a run for its workers: how many, and the cluster that they are jobs of."""
    from dicflow.io.cluster_file import cluster_of, workers_of

    least, most = workers_of(given)
    if cluster and scheduler != "auto":
        raise ConfigurationError(f"--cluster {cluster} starts a scheduler of its own; leave --scheduler out")
    if cluster:
        return {"workers": os.cpu_count() or 1, "cluster": cluster_of(cluster, least, most)}
    if least != most:
        raise ConfigurationError(f"--workers {given}: a range is for --cluster; give one number")
    return {"workers": least}


def compute_and_write(
    loaded: Pipeline, folder: Path, phases: Phases, *, pictures: bool, report: bool, **options: Any
) -> tuple[Result, int]:
    """Run a loaded pipeline, and write pictures, tables and the report into a folder; each part is noted in `phases`.

    options : of the run, with its workers
    Returns the result, and the exit code of the command.
    """
    from dicflow.pipeline.profile import TASKS
    from dicflow.views.console import consoles
    from dicflow.views.progress import Progress

    _, progress = consoles()
    with Progress(progress, _afterwards(loaded, pictures=pictures, report=report)) as shown:
        result = _compute(loaded, shown, phases, draws=pictures or report, **options)
        phases.end(TASKS)
        drawn = _draw(loaded, result, folder, options["workers"], shown, phases, pictures=pictures, report=report)
    _print_run(progress, result, folder, drawn)
    return result, _exit_code(result, drawn)


class _Drawn(NamedTuple):
    """What was written beside the products.

    files : maps and tables; report : the page, None without one; problems : of its sections
    interrupted : whether somebody pressed Ctrl-C meanwhile
    """

    files: list[Path]
    report: Path | None
    problems: list[str]
    interrupted: bool = False


def _afterwards(loaded: Pipeline, *, pictures: bool, report: bool) -> dict[str, float]:
    """What is drawn after the tasks, and about how long it takes [s]; it moves the bar alone."""
    steps = max(map(len, loaded.graph.steps.values()), default=0)
    expected = {
        "pictures": 0.06 * min(steps, 24) if pictures else 0.0,
        "report": 2.0 + 0.004 * steps if report else 0.0,
    }
    return {what: seconds for what, seconds in expected.items() if seconds}


def _compute(loaded: Pipeline, shown: Progress, phases: Phases, *, draws: bool, **options: Any) -> Result:
    """The run of a loaded pipeline, the end of its plan noted in `phases`.

    draws : whether something is drawn afterwards, the code of which is loaded while workers compute
    """

    def on_event(event: Event) -> None:
        if event.kind == "planned":
            phases.end("plan")
            if draws and event.counts["run"]:
                Thread(target=_load_drawing, daemon=True).start()
        shown.on_event(event)

    return loaded.run(on_event=on_event, **options)


def _load_drawing() -> None:
    import dicflow.report.build
    import dicflow.report.reporting
    import dicflow.views.published_maps  # noqa: F401


def _draw(
    loaded: Pipeline,
    result: Result,
    folder: Path,
    workers: int,
    shown: Progress,
    phases: Phases,
    *,
    pictures: bool,
    report: bool,
) -> _Drawn:
    """Write pictures, tables and the report of a run; Ctrl-C ends it, and what is drawn is kept."""
    from dicflow.report.build import write_report
    from dicflow.views.publish import publish

    drawn = _Drawn([], None, [])
    try:
        files = publish(result, folder, workers, pictures=pictures, note=shown.drawing("pictures"))
        drawn = drawn._replace(files=files)
        phases.end("pictures and tables")
        if report:
            page = write_report(loaded, result, folder, workers, drawn.problems.append, shown.drawing("report"))
            drawn = drawn._replace(report=page)
            phases.end("report")
    except KeyboardInterrupt:
        return drawn._replace(interrupted=True)
    return drawn


def _exit_code(result: Result, drawn: _Drawn) -> int:
    assert result.outcome is not None
    return 130 if result.outcome.interrupted or drawn.interrupted else 0 if result.outcome.ok else 1


def _run_line(result: Result) -> dict[str, Any]:
    """The last line of ``--json``."""
    outcome = result.outcome
    assert outcome is not None
    counts = {name: outcome.counts.get(name, 0) for name in STATUSES}
    return {
        "run": outcome.run_id,
        "counts": counts,
        "seconds": round(outcome.seconds, 3),
        "warnings": list(outcome.warnings),
        "stages": outcome.by_stage(),
    }


def _end_run(result: Result, phases: Phases | None, as_json: bool) -> None:
    """The last lines: where the time went, if phases are given, and the line of ``--json``."""
    profile: dict[str, Any] = {}
    if phases is not None:
        from dicflow.pipeline.profile import shares
        from dicflow.views.console import consoles
        from dicflow.views.profile import profile_json, profile_table

        assert result.outcome is not None
        found = shares(phases, result.outcome)
        consoles()[1].print(profile_table(found))
        profile = {"profile": profile_json(found)}
    if as_json:
        say(json.dumps({**_run_line(result), **profile}))


def _print_run(console: Console, result: Result, folder: Path, drawn: _Drawn) -> None:
    """Verdicts, warnings, counts and where the files are."""
    outcome = result.outcome
    assert outcome is not None
    _print_warnings(console, result, outcome.warnings)
    _print_failures(console, result)
    counts = ", ".join(f"{number} {name}" for name, number in outcome.counts.items() if number)
    console.print(f"{counts} in {outcome.seconds:.1f} s, run {outcome.run_id}", soft_wrap=True)
    if outcome.interrupted:
        console.print("interrupted; finished tasks are kept, and the same command continues", style="yellow")
    elif drawn.interrupted:
        console.print("interrupted; all is measured, and the same command draws what is missing", style="yellow")
    if drawn.files:
        console.print(f"{len(drawn.files)} maps and tables in {folder}", soft_wrap=True)
    for problem in drawn.problems:
        console.print(f"warning: {problem}", style="yellow", soft_wrap=True)
    if drawn.report is not None:
        console.print(f"report: {drawn.report}", soft_wrap=True)


def _print_warnings(console: Console, result: Result, warnings: Sequence[str]) -> None:
    """Verdicts that no warning has, and warnings."""
    from dicflow.kinds.rig import CalibratedRig

    for stage in result.stages_of("rig"):
        if result.has(stage):
            verdict = CalibratedRig.read(result.product(stage)).verdict
            if not any(verdict in warning for warning in warnings):
                console.print(f"{stage}: {verdict}", soft_wrap=True)
    for warning in warnings:
        console.print(f"warning: {warning}", style="yellow", soft_wrap=True)


def _print_failures(console: Console, result: Result) -> None:
    """Why tasks failed, and where troubleshooting speaks of failures and warnings."""
    from dicflow.engine.product_warnings import failures

    assert result.outcome is not None
    found = failures(result.graph, result.outcome.outcomes)
    for text in found[:_MOST_FAILURES]:
        console.print(f"failed: {text}", style="red", soft_wrap=True)
    if (more := len(found) - _MOST_FAILURES) > 0:
        console.print(f"failed: {more} further messages, which stand above", style="red")
    if topics := _topics(result):
        console.print(advice(topics), style="dim", soft_wrap=True)


def _topics(result: Result) -> list[str]:
    """Sections of troubleshooting for the stages that failed or warned."""
    outcome = result.outcome
    assert outcome is not None
    stages = [done.stage for done in outcome.outcomes.values() if done.status == "failed" or done.warnings]
    return [topic_of(type(result.graph.stages[stage].node).__module__) for stage in stages]


def _until_enter() -> None:
    typer.prompt("dashboard stays up; press Enter to end", default="", show_default=False, err=True)
