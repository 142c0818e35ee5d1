"""The command line. Exit codes: 0 ok, 1 some stages failed, 2 bad configuration, 130 interrupted."""

from __future__ import annotations

import json
import os
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dicflow._version import __version__
from dicflow.errors import ConfigurationError, DicflowError

if TYPE_CHECKING:
    from rich.console import Console

    from dicflow.pipeline import Pipeline, Result

__all__ = ["app", "main"]

app = typer.Typer(
    name="dicflow",
    help="Full-field displacement and strain from photographs of two cameras.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


class CodePolicy(StrEnum):
    """What to do with products whose stage's code has changed since."""

    recompute = "recompute"
    warn = "warn"
    ignore = "ignore"


class Format(StrEnum):
    """File formats of exports."""

    csv = "csv"
    npz = "npz"
    png = "png"


PipelineFile = Annotated[Path, typer.Argument(metavar="PIPELINE", help="pipeline file, such as pipeline.yaml")]
Data = Annotated[
    Path | None, typer.Option(help="folder where the file's relative paths start; default: the file's own")
]
StoreFolder = Annotated[
    Path | None, typer.Option("--store", help="folder of the products; default: .dicflow beside the file")
]
Settings = Annotated[
    list[str],
    typer.Option(
        "--set",
        default_factory=list,
        metavar="STAGE.PARAMETER=VALUE",
        help="another value; several, v1,v2,v3, make a sweep",
    ),
]
Policy = Annotated[CodePolicy, typer.Option(help="for products of code that has changed since")]
Step = Annotated[str | None, typer.Option(help="name of the step; default: every step")]
Force = Annotated[bool, typer.Option("--force", help="overwrite files that exist")]
VariantNumber = Annotated[int, typer.Option("--variant", min=1, help="number of the sweep's variant")]


@app.command()
def run(
    pipeline: PipelineFile,
    settings: Settings,
    data: Data = None,
    store: StoreFolder = None,
    output: Annotated[
        Path | None, typer.Option(help="folder of pictures and tables; default: results/NAME beside the file")
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="workers at once; default: one per core")] = os.cpu_count() or 1,
    scheduler: Annotated[
        str, typer.Option(help="processes, threads, sync, or tcp://… or tls://… of a dask scheduler")
    ] = "processes",
    dashboard: Annotated[
        bool, typer.Option("--dashboard", help="serve dask's dashboard on this machine and print its link")
    ] = False,
    wait: Annotated[bool, typer.Option("--wait", help="keep the dashboard until Enter is pressed")] = False,
    keep_going: Annotated[
        bool, typer.Option("--keep-going", help="after a failure go on with all that does not depend on it")
    ] = False,
    code_policy: Policy = CodePolicy.recompute,
    as_json: Annotated[bool, typer.Option("--json", help="end with one line of JSON on standard output")] = False,
) -> None:
    """Compute what is missing, then write maps and tables.

    \b
    dicflow run pipeline.yaml
    dicflow run pipeline.yaml --set surface.robust=LAR
    dicflow run pipeline.yaml --set smooth.degree=1,2,3 --workers 4
    """
    from dicflow.io.files import make_folder
    from dicflow.views.console import Progress, consoles
    from dicflow.views.publish import publish

    out, progress = consoles()
    loaded = _load(pipeline, data, store, settings)
    folder = output or pipeline.parent / "results" / loaded.name
    assert loaded.graph
    make_folder(folder)
    with Progress(progress) as shown:
        result = loaded.run(
            scheduler=scheduler,
            workers=workers,
            dashboard=dashboard,
            code_policy=code_policy.value,
            keep_going=keep_going,
            on_event=shown.on_event,
            linger=_until_enter if dashboard and wait else None,
        )
    files = publish(result, folder, workers)
    _tell_run(progress, result, folder, files)
    if as_json:
        out.print(json.dumps(_run_line(result)), soft_wrap=True)
    raise typer.Exit(_exit_code(result))


@app.command()
def plan(
    pipeline: PipelineFile,
    settings: Settings,
    data: Data = None,
    store: StoreFolder = None,
    code_policy: Policy = CodePolicy.recompute,
) -> None:
    """Say what a run would compute, and why; nothing is computed.

    \b
    dicflow plan pipeline.yaml
    dicflow plan pipeline.yaml --set smooth.window=[40,20]
    """
    from dicflow.views.console import consoles, plan_table

    out, _ = consoles()
    made = _load(pipeline, data, store, settings).plan(code_policy.value)
    for warning in made.warnings:
        out.print(f"warning: {warning}", style="yellow", soft_wrap=True)
    out.print(plan_table(made))


@app.command()
def why(
    pipeline: PipelineFile,
    stage: Annotated[str, typer.Argument(help="name of a stage, or of one task such as disparity/step_03")],
    settings: Settings,
    data: Data = None,
    store: StoreFolder = None,
) -> None:
    """Say what has changed for a stage since it was computed.

    Parameters old → new, inputs, files, code.

    \b
    dicflow why pipeline.yaml strain
    """
    from dicflow.views.console import consoles, why_lines

    out, _ = consoles()
    for line in why_lines(_load(pipeline, data, store, settings).plan(), stage):
        out.print(line, soft_wrap=True)


@app.command()
def graph(
    pipeline: PipelineFile,
    settings: Settings,
    data: Data = None,
    output: Annotated[Path | None, typer.Option(help="SVG file to write; default: text on the terminal")] = None,
    force: Force = False,
) -> None:
    """Show the stages and what each takes from which.

    \b
    dicflow graph pipeline.yaml
    dicflow graph pipeline.yaml --output graph.svg
    """
    from dicflow.views.graph import graph_svg, graph_text

    loaded = _load(pipeline, data, None, settings)
    if output is None:
        typer.echo(graph_text(loaded.graph))
    else:
        _write(output, graph_svg(loaded.graph).encode(), force)


@app.command("ls")
def list_products(pipeline: PipelineFile, settings: Settings, data: Data = None, store: StoreFolder = None) -> None:
    """List the products of a pipeline, and how many are there.

    \b
    dicflow ls pipeline.yaml
    """
    from dicflow.views.console import consoles, products_table

    out, _ = consoles()
    out.print(products_table(_load(pipeline, data, store, settings).result()))


@app.command()
def show(
    pipeline: PipelineFile,
    product: Annotated[str, typer.Argument(help="stage, or stage/step")],
    settings: Settings,
    data: Data = None,
    store: StoreFolder = None,
    variant: VariantNumber = 1,
) -> None:
    """Show one product: its arrays, their units and ranges.

    \b
    dicflow show pipeline.yaml rig
    dicflow show pipeline.yaml total/step_03
    """
    from dicflow.views.console import consoles, product_tables

    out, _ = consoles()
    stage, _sign, step = product.partition("/")
    result = _load(pipeline, data, store, settings).result()
    for part in product_tables(result.product(stage, step or None, _index(result, variant))):
        out.print(part, soft_wrap=isinstance(part, str))


@app.command()
def export(
    pipeline: PipelineFile,
    stage: Annotated[str, typer.Argument(help="stage whose products are written")],
    settings: Settings,
    step: Step = None,
    to: Annotated[Format, typer.Option("--format", help="csv: a table; npz: all arrays; png: pictures")] = Format.csv,
    output: Annotated[Path, typer.Option(help="folder for the files")] = Path("export"),
    data: Data = None,
    store: StoreFolder = None,
    variant: VariantNumber = 1,
    force: Force = False,
) -> None:
    """Write products as CSV, NPZ or PNG, by stage and step.

    \b
    dicflow export pipeline.yaml total --format csv
    dicflow export pipeline.yaml disparity --step step_03 --format png --output pictures
    """
    from dicflow.views.exports import exported

    result = _load(pipeline, data, store, settings).result()
    for name, content in exported(result, stage, step, to.value, _index(result, variant)):
        _write(output / name, content, force)
        typer.echo(output / name)


@app.command()
def gc(
    store: Annotated[Path, typer.Argument(metavar="STORE", help="folder of the store, such as .dicflow")],
    keep_runs: Annotated[int, typer.Option(min=0, help="newest runs of each pipeline that keep their products")] = 5,
    delete: Annotated[bool, typer.Option("--delete", help="delete it; without this only say what would go")] = False,
) -> None:
    """Free what no recent run and no pin needs any more.

    \b
    dicflow gc .dicflow
    dicflow gc .dicflow --keep-runs 1 --delete
    """
    from dicflow.engine.housekeeping import collect

    garbage = collect(_store(store), keep_runs=keep_runs, delete=delete)
    verb = "freed" if delete else "would free"
    typer.echo(
        f"{verb} {garbage.nbytes / 1e6:.1f} MB: {len(garbage.objects)} products, {len(garbage.records)} records, "
        f"{len(garbage.runs)} runs" + ("" if delete else "; add --delete to do it")
    )


@app.command()
def verify(
    store: Annotated[Path, typer.Argument(metavar="STORE", help="folder of the store, such as .dicflow")],
    repair: Annotated[
        bool, typer.Option("--repair", help="set damaged products aside, so that they are made again")
    ] = False,
) -> None:
    """Read every product of a store and compare it with its digest.

    \b
    dicflow verify .dicflow
    """
    from dicflow.engine import housekeeping

    damages = housekeeping.verify(_store(store), repair=repair)
    for damage in damages:
        typer.echo(f"{damage.what}: {damage.reason}")
    typer.echo(
        "nothing is damaged"
        if not damages
        else f"{len(damages)} damaged{', set aside' if repair else '; add --repair'}"
    )
    raise typer.Exit(1 if damages else 0)


@app.command()
def pin(
    store: Annotated[Path, typer.Argument(metavar="STORE", help="folder of the store, such as .dicflow")],
    run_id: Annotated[
        str | None, typer.Argument(metavar="RUN", help="id of a run; without it the runs and their pins are listed")
    ] = None,
    note: Annotated[str, typer.Option(help="why it is kept")] = "",
    remove: Annotated[bool, typer.Option("--remove", help="take the pin away")] = False,
) -> None:
    """Keep the products of a run whatever gc is asked to free.

    \b
    dicflow pin .dicflow
    dicflow pin .dicflow 20260131-101500-ab12 --note "figures of the paper"
    """
    from dicflow.engine import housekeeping
    from dicflow.engine.journal import runs

    opened = _store(store)
    if run_id is None:
        kept = housekeeping.pins(opened)
        for info in runs(opened):
            typer.echo(f"{info.id}  {info.pipeline}" + (f"  pinned: {kept[info.id]}" if info.id in kept else ""))
    elif remove:
        housekeeping.unpin(opened, run_id)
    else:
        housekeeping.pin(opened, run_id, note)


@app.command()
def schema() -> None:
    """Print the JSON schema of pipeline files, for an editor.

    \b
    dicflow schema > pipeline.schema.json
    """
    from dicflow.pipeline.schema import pipeline_schema

    typer.echo(json.dumps(pipeline_schema(), indent=1, ensure_ascii=False))


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(help="folder that holds the photographs and the board photographs")],
    square: Annotated[str | None, typer.Option(help="side of a square of the board, such as '14.5 mm'")] = None,
    force: Force = False,
) -> None:
    """Write a commented pipeline.yaml for a folder of photographs.

    \b
    dicflow init experiment --square "14.5 mm"
    """
    from dicflow.pipeline.setup import OPEN, look, pipeline_text

    path = folder / "pipeline.yaml"
    _vacant(path, force)
    text = pipeline_text(look(folder, typer.echo), square, path)
    _write(path, text.encode(), force)
    first = "fill in the side of a square" if OPEN in text else "read it"
    typer.echo(f"wrote {path}; {first}, then: dicflow run {path}")


synth = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="Make photographs of experiments whose truth is known."
)
app.add_typer(synth, name="synth")


@synth.command("latex")
def synth_latex(
    folder: Annotated[Path, typer.Argument(help="folder to write")],
    experiment: Annotated[int, typer.Option(min=1, max=5, help="number of the tensile test that is replicated")] = 1,
    scale: Annotated[float, typer.Option(min=0.2, max=2, help="size of the photographs against 1440 × 1920 px")] = 1.0,
    workers: Annotated[int, typer.Option(min=1, help="photographs rendered at once")] = os.cpu_count() or 1,
    force: Force = False,
) -> None:
    """Replicate a tensile test on latex: photographs, boards, caliper table, region and truth.

    \b
    dicflow synth latex replica_3 --experiment 3
    dicflow run pipelines/latex_experiment_3.yaml --data replica_3
    """
    from dicflow.synth import latex_experiment, write_experiment

    _free(folder, force)
    write_experiment(folder, latex_experiment(experiment, scale=scale), workers=workers, on_progress=_tick)


@synth.command("sample")
def synth_sample(folder: Annotated[Path, typer.Argument(help="folder to write")], force: Force = False) -> None:
    """Make the reduced experiment of data_samples again.

    \b
    dicflow synth sample data_samples --force
    """
    from dicflow.synth import write_sample

    _free(folder, force)
    write_sample(folder, on_progress=_tick)


@app.command()
def doctor(store: Annotated[Path, typer.Option(help="folder where products would be kept")] = Path(".dicflow")) -> None:
    """Check this machine and installation.

    \b
    dicflow doctor
    """
    from dicflow.pipeline.doctor import checks

    found = list(checks(store))
    for check in found:
        typer.echo(f"{'ok     ' if check.ok else 'PROBLEM'}  {check.subject}: {check.finding}")
    raise typer.Exit(0 if all(check.ok for check in found) else 1)


@app.callback(invoke_without_command=True)
def root(version: Annotated[bool, typer.Option("--version", help="print the version")] = False) -> None:
    if version:
        typer.echo(f"dicflow {__version__}")
        raise typer.Exit


def main() -> None:
    """Run the command line; every error meant for users is one message, without a traceback."""
    from dicflow.engine.workers import limit_threads

    limit_threads()
    try:
        app()
    except DicflowError as error:
        typer.secho(str(error), fg="red", err=True)
        sys.exit(error.exit_code)


def _load(pipeline: Path, data: Path | None, store: Path | None, settings: list[str]) -> Pipeline:
    from dicflow.pipeline import Pipeline

    return Pipeline.load(pipeline, data=data, store=store, settings=settings)


def _store(folder: Path) -> Any:
    from dicflow.engine.store import Store

    return Store.open(folder, create=False)


def _exit_code(result: Result) -> int:
    assert result.outcome is not None
    return 130 if result.outcome.interrupted else 0 if result.outcome.ok else 1


def _run_line(result: Result) -> dict[str, Any]:
    """The line that ``--json`` ends with."""
    outcome = result.outcome
    assert outcome is not None
    counts = {name: outcome.counts.get(name, 0) for name in ("hit", "computed", "failed", "skipped")}
    return {"run": outcome.run_id, "counts": counts, "seconds": round(outcome.seconds, 3), "stages": outcome.by_stage()}


def _tell_run(console: Console, result: Result, folder: Path, files: list[Path]) -> None:
    """Verdicts, counts and where the files are."""
    outcome = result.outcome
    assert outcome is not None
    for stage in result.stages_of("rig"):
        if result.has(stage):
            console.print(f"{stage}: {result.product(stage).attrs['verdict']}", soft_wrap=True)
    counts = ", ".join(f"{number} {name}" for name, number in outcome.counts.items() if number)
    console.print(f"{counts} in {outcome.seconds:.1f} s, run {outcome.run_id}", soft_wrap=True)
    if outcome.interrupted:
        console.print("interrupted; what is done is kept, and the same command goes on from here", style="yellow")
    if files:
        console.print(f"{len(files)} maps and tables in {folder}", soft_wrap=True)


def _until_enter() -> None:
    typer.prompt("dashboard stays up; press Enter to end", default="", show_default=False, err=True)


def _tick(done: int, total: int, name: str) -> None:
    typer.echo(f"{done}/{total} {name}", err=True)


def _free(folder: Path, force: bool) -> None:
    if folder.is_dir() and any(folder.iterdir()) and not force:
        raise ConfigurationError(f"{folder} is not empty; name another folder or add --force")


def _write(path: Path, content: bytes, force: bool) -> None:
    """A new file, whole or not at all."""
    from dicflow.io.files import write_whole

    _vacant(path, force)
    write_whole(path, content)


def _vacant(path: Path, force: bool) -> None:
    if path.exists() and not force:
        raise ConfigurationError(f"{path} exists; add --force to overwrite it, or name another")


def _index(result: Result, variant: int) -> int:
    """The place of a variant that is counted from 1."""
    if variant > len(result.values):
        raise ConfigurationError(f"--variant {variant}: there are {len(result.values)}, counted from 1")
    return variant - 1


if __name__ == "__main__":
    main()
