"""Commands around a measurement: stages, a first file, its schema, synthetic photographs, a check of the machine."""

from __future__ import annotations

import json
import os
import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from dicflow.cli.options import Force, refuse_existing, refuse_full, say, tick, warn, write_new
from dicflow.discovery import nearest
from dicflow.errors import ConfigurationError

__all__ = ["demo", "doctor", "help_topics", "init", "schema", "stages", "synth", "warm"]

PairBy = Literal["name", "taken", "order"]


def schema() -> None:
    """Print the JSON schema of pipeline files, for an editor.

    \b
    dicflow schema > pipeline.schema.json
    """
    from dicflow.pipeline.registry import node_classes
    from dicflow.pipeline.schema import pipeline_schema

    for problem in node_classes()[1]:
        warn(problem)
    say(json.dumps(pipeline_schema(), indent=1, ensure_ascii=False))


def stages(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="a stage; default: list all")] = None,
) -> None:
    """List the stages, or print one with its parameters.

    \b
    dicflow stages
    dicflow stages correlate
    """
    from dicflow.pipeline.registry import node_class, node_classes, stage_names
    from dicflow.pipeline.stage_words import list_lines, stage_lines

    if name is not None:
        _check_stage(name, stage_names())
        say("\n".join(stage_lines(name, node_class(name))))
        return
    kinds, problems = node_classes()
    say("\n".join(list_lines(kinds)))
    for problem in problems:
        warn(problem)


def _check_stage(name: str, known: Sequence[str]) -> None:
    """Raise ConfigurationError for an unknown stage, with the name that is nearest in any spelling."""
    if name in known:
        return
    near = nearest(re.sub(r"[\W_]+", "_", name).lower(), known)
    raise ConfigurationError(
        f"no stage '{name}'{near or '; stages: ' + ', '.join(known)}; 'dicflow stages' says what each does"
    )


def _named(subject: str) -> Any:
    """An option that names folders or patterns, repeatable."""
    words = f"photographs of {subject}: a folder below, or a pattern; repeatable"
    return typer.Option(default_factory=list, show_default=False, metavar="PATTERN", help=words)


def init(
    folder: Annotated[Path, typer.Argument(help="folder that holds the photographs of the specimen and of the board")],
    left: Annotated[list[str], _named("the left camera")],
    right: Annotated[list[str], _named("the right camera")],
    boards: Annotated[list[str], _named("boards, of both cameras")],
    one_camera: Annotated[bool, typer.Option("--one-camera", help="measure in the plane, with one camera")] = False,
    square: Annotated[str | None, typer.Option(help="side of a square of the board, such as '14.5 mm'")] = None,
    pair_by: Annotated[
        PairBy | None,
        typer.Option(help="pair the photographs by their names, by the time when they were taken, or in order"),
    ] = None,
    force: Force = False,
) -> None:
    """Write a commented pipeline.yaml for a folder of photographs.

    The two cameras are found by the names of folders and files, boards and specimen by what the photographs show. Where
    this leaves a doubt, nothing is written, and the message has a command line for each possibility. Photographs whose
    names do not agree are paired by the time when they were taken; the clocks may differ.

    \b
    dicflow init experiment --square "14.5 mm"
    dicflow init experiment --left "phone A" --right "phone B" --boards "*/calibration"
    """
    from dicflow.start.choice import Choice
    from dicflow.start.first_file import OPEN, pipeline_text, with_unit
    from dicflow.start.folder import look

    path = folder / "pipeline.yaml"
    refuse_existing(path, force, f"keep it: {shlex.join(['dicflow', 'run', str(path)])}")
    square = with_unit(square) if square else None
    command = ["dicflow", "init", str(folder), *(["--square", square] if square else []), *["--force"] * force]
    choice = Choice(tuple(left), tuple(right), tuple(boards), one_camera, pair_by, pair_by)
    text = pipeline_text(look(folder, choice, command, say), square, path)
    write_new(path, text.encode(), force)
    first = f"fill in what is marked '{OPEN}'" if OPEN in text else "read it"
    say(f"wrote {path}; {first}, then: {shlex.join(['dicflow', 'run', str(path)])}")


def demo(
    folder: Annotated[Path, typer.Argument(help="folder to write")] = Path("dicflow-demo"), force: Force = False
) -> None:
    """Measure a small experiment, from photographs to the report.

    A strip of latex and a checkerboard are photographed by rendering, 8 pairs and 12, with the lengths of a caliper
    beside them. The rest is what init and run do in a folder of yours.

    \b
    dicflow demo
    """
    from dicflow.cli.measure import run
    from dicflow.synth import sample_experiment, write_experiment

    refuse_full(folder, force)
    experiment = sample_experiment()
    write_experiment(folder, experiment, workers=os.cpu_count() or 1, on_progress=tick)
    init(folder, [], [], [], square=f"{experiment.board.square} mm", force=force)
    try:
        run(folder / "pipeline.yaml", [])
    finally:
        say(f"look around: {shlex.join(['dicflow', 'app', str(folder)])}")


def help_topics(
    topics: Annotated[list[str], typer.Argument(metavar="TOPIC", default_factory=list, help="default: list all")],
) -> None:
    """Say what to do about an error or a warning.

    Prints sections of the manual's page on troubleshooting.

    \b
    dicflow help photographs
    """
    from dicflow.discovery import nearest
    from dicflow.views.topics import sections

    known = sections()
    for topic in topics:
        if topic not in known:
            raise ConfigurationError(f"no topic '{topic}'{nearest(topic, known)}; topics: {', '.join(known)}")
        say(re.sub(r"\[([^]]+)\]\([^)]*\)", r"\1", known[topic]))
    if not topics:
        say("\n".join(known))


synth = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Make experiments whose truth is known.")


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

    refuse_full(folder, force)
    replica = latex_experiment(experiment, scale=scale)
    write_experiment(folder, replica, workers=workers, on_progress=tick)
    _say_next(folder, replica.board.square)


@synth.command("sample")
def synth_sample(folder: Annotated[Path, typer.Argument(help="folder to write")], force: Force = False) -> None:
    """Photograph a strip of latex and a checkerboard, with a caliper's table: the experiment of data_samples.

    \b
    dicflow synth sample strip
    dicflow synth sample data_samples --force
    """
    from dicflow.synth import sample_experiment, write_sample

    refuse_full(folder, force)
    write_sample(folder, on_progress=tick)
    _say_next(folder, sample_experiment().board.square)


def _say_next(folder: Path, square: float) -> None:
    """How one goes on. square : side of a square of the board [mm]"""
    say(f"next: {shlex.join(['dicflow', 'init', str(folder), '--square', f'{square} mm'])}")


@synth.command("rubber")
def synth_rubber(folder: Annotated[Path, typer.Argument(help="folder to write")], force: Force = False) -> None:
    """Make tables of three tests on one rubber whose constants are known.

    \b
    dicflow synth rubber data_samples/rubber --force
    dicflow run pipelines/rubber_curves.yaml --data data_samples/rubber
    """
    from dicflow.synth.rubber import write_rubber

    refuse_full(folder, force)
    write_rubber(folder)


@synth.command("sheets")
def synth_sheets(
    folder: Annotated[Path, typer.Argument(help="folder to write")],
    model: Annotated[str, typer.Option(help="neo_hooke, mooney_rivlin, yeoh or ogden_2")] = "mooney_rivlin",
    damage: Annotated[float, typer.Option(min=0, max=0.9, help="share of the stress lost on unloading")] = 0.0,
    down: Annotated[int, typer.Option(min=0, max=12, help="steps of unloading")] = 0,
    seed: Annotated[int, typer.Option(help="of thickness, weights, pattern and noise")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="photographs rendered at once")] = os.cpu_count() or 1,
    force: Force = False,
) -> None:
    """Photograph three sheets of one rubber in equilibrium with weights.

    \b
    dicflow synth sheets sheets --model yeoh
    dicflow run pipelines/latex_material.yaml --data sheets
    """
    from dicflow.synth.sheets import CONSTANTS, Rubber, write_sheets

    if model not in CONSTANTS:
        raise ConfigurationError(f"--model is '{model}'; expected one of {', '.join(CONSTANTS)}")
    refuse_full(folder, force)
    rubber = Rubber(model, CONSTANTS[model], down=down, damage=damage, seed=seed)
    write_sheets(folder, rubber, workers=workers, on_progress=tick)


def warm(
    workers: Annotated[int, typer.Option(min=1, help="processes at once; default: one per core")] = os.cpu_count() or 1,
) -> None:
    """Compile ahead what the first run would compile.

    Kernels are kept for this account, modules beside their source; a run compiles what it lacks, too.

    \b
    dicflow warm
    """
    from dicflow.pipeline.warm import warm as warmed

    for line in warmed(workers):
        say(line)


def doctor(store: Annotated[Path, typer.Option(help="folder where products would be kept")] = Path(".dicflow")) -> None:
    """Check this machine and installation.

    \b
    dicflow doctor
    """
    from dicflow.start.doctor import checks

    found = list(checks(store))
    for check in found:
        say(f"{'ok     ' if check.ok else 'PROBLEM'}  {check.subject}: {check.finding}")
    raise typer.Exit(0 if all(check.ok for check in found) else 1)
