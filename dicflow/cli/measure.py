"""Commands that compute: run, plan, why."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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

if TYPE_CHECKING:
    from rich.console import Console

    from dicflow.engine.journal import Event
    from dicflow.engine.phases import Phases
    from dicflow.pipeline import Pipeline, Result

__all__ = ["compute_and_write", "exit_code", "plan", "run", "why"]


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
    result = compute_and_write(
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
    raise typer.Exit(exit_code(result))


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
    from dicflow.views.console import Progress, consoles, plan_table

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
    from dicflow.views.console import Progress, consoles, why_lines

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
) -> Result:
    """Run a loaded pipeline, and write pictures, tables and the report into a folder; each part is noted in `phases`.

    options : of the run, with its workers
    """
    from dicflow.pipeline.profile import TASKS
    from dicflow.views.console import consoles

    _, progress = consoles()
    result = _compute(loaded, progress, phases, **options)
    phases.end(TASKS)
    _write_files(result, folder, options["workers"], progress, pictures=pictures)
    phases.end("pictures and tables")
    if report:
        _write_report(loaded, result, folder, options["workers"], progress)
        phases.end("report")
    return result


def _compute(loaded: Pipeline, progress: Console, phases: Phases, **options: Any) -> Result:
    """The run of a loaded pipeline, its progress shown, the end of its plan noted in `phases`."""
    from dicflow.views.console import Progress

    with Progress(progress) as shown:

        def on_event(event: Event) -> None:
            if event.kind == "planned":
                phases.end("plan")
            shown.on_event(event)

        return loaded.run(on_event=on_event, **options)


def _write_files(result: Result, folder: Path, workers: int, progress: Console, *, pictures: bool) -> None:
    """Write pictures and tables of a run, and print where they are."""
    from dicflow.views.publish import publish

    files = publish(result, folder, workers, pictures=pictures)
    _print_run(progress, result, folder, files)


def _write_report(loaded: Pipeline, result: Result, folder: Path, workers: int, progress: Console) -> None:
    """Write the report of a run, and print where it is."""
    from dicflow.report.build import write_report

    problems: list[str] = []
    report = write_report(loaded, result, folder, workers, problems.append)
    for problem in problems:
        progress.print(f"warning: {problem}", style="yellow", soft_wrap=True)
    progress.print(f"report: {report}", soft_wrap=True)


def exit_code(result: Result) -> int:
    """Exit code of the command after a run."""
    assert result.outcome is not None
    return 130 if result.outcome.interrupted else 0 if result.outcome.ok else 1


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


def _print_run(console: Console, result: Result, folder: Path, files: list[Path]) -> None:
    """Verdicts that no warning has, warnings, counts and where the files are."""
    outcome = result.outcome
    assert outcome is not None
    from dicflow.kinds.rig import CalibratedRig

    for stage in result.stages_of("rig"):
        if result.has(stage):
            verdict = CalibratedRig.read(result.product(stage)).verdict
            if not any(verdict in warning for warning in outcome.warnings):
                console.print(f"{stage}: {verdict}", soft_wrap=True)
    for warning in outcome.warnings:
        console.print(f"warning: {warning}", style="yellow", soft_wrap=True)
    counts = ", ".join(f"{number} {name}" for name, number in outcome.counts.items() if number)
    console.print(f"{counts} in {outcome.seconds:.1f} s, run {outcome.run_id}", soft_wrap=True)
    if outcome.interrupted:
        console.print("interrupted; finished tasks are kept, and the same command continues", style="yellow")
    if files:
        console.print(f"{len(files)} maps and tables in {folder}", soft_wrap=True)


def _until_enter() -> None:
    typer.prompt("dashboard stays up; press Enter to end", default="", show_default=False, err=True)
