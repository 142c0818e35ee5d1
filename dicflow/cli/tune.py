"""The command tune: settings by a sweep."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dicflow.cli.options import (
    Data,
    Output,
    PipelineFile,
    Settings,
    StoreFolder,
    load,
    results_folder,
)

if TYPE_CHECKING:
    from rich.console import Console

    from dicflow.pipeline import Pipeline, Result
    from dicflow.tuning.tune import Begun, Tuning

__all__ = ["tune"]


def tune(
    pipeline: PipelineFile,
    settings: Settings,
    resolve: Annotated[
        str | None, typer.Option(metavar="LENGTH", help="side of the virtual strain gauge at most: '3 mm' or '40 px'")
    ] = None,
    noise: Annotated[
        str | None, typer.Option(metavar="STRAIN", help="noise at most: 500e-6, '500 µε' or '0.05 %'")
    ] = None,
    apply: Annotated[bool, typer.Option("--apply", help="write the recommended settings to the file")] = False,
    data: Data = None,
    store: StoreFolder = None,
    output: Output = None,
    workers: Annotated[int, typer.Option(min=1, help="workers at once; default: one per core")] = os.cpu_count() or 1,
) -> None:
    """Recommend subset, step and window, tried at a few steps.

    Without --resolve and --noise it is the setting of least error, noise and bias together.

    \b
    dicflow tune pipeline.yaml
    dicflow tune pipeline.yaml --resolve "3 mm" --apply
    dicflow tune pipeline.yaml --noise "500 µε"
    """
    from functools import partial

    from dicflow.io.edited_yaml import require_editor
    from dicflow.tuning.choice import wish
    from dicflow.tuning.tune import tune as tuned
    from dicflow.tuning.written import write_settings
    from dicflow.views.console import consoles

    wished = wish(resolve, noise)
    if apply:
        require_editor()
    out, progress = consoles()
    loaded = load(pipeline, data, store, settings)
    measure = partial(_measured, console=progress, workers=workers)
    found = tuned(loaded, wished, measure, lambda begun: _print_begun(progress, begun, workers))
    _print_found(out, found, _write_files(found, results_folder(loaded, output) / "tune"))
    if found.choice.trial is not None and apply:
        changed = write_settings(loaded.path, found.tuned, found.choice.trial.setting)
        said = ", ".join(f"{name}: {value}" for name, value in changed.items())
        out.print(f"written to {loaded.path.name}: {said or 'nothing, it has these settings'}", soft_wrap=True)
    for warning in found.warnings:
        progress.print(f"warning: {warning}", style="yellow", soft_wrap=True)
    raise typer.Exit(0 if found.choice.trial is not None else 1)


def _measured(pipeline: Pipeline, console: Console, workers: int) -> Result:
    """Run a pipeline with its progress, one line for all variants of a stage."""
    from dicflow.views.console import joined_variants
    from dicflow.views.progress import Progress

    with Progress(console) as shown:
        result = pipeline.run(
            on_event=lambda event: shown.on_event(joined_variants(event)), workers=workers, keep_going=True
        )
    if result.outcome is not None and result.outcome.interrupted:
        console.print("interrupted; finished tasks are kept, and the same command continues", style="yellow")
        raise typer.Exit(130)
    return result


def _print_begun(console: Console, begun: Begun, workers: int) -> None:
    from dicflow.tuning.choice import strain_text

    steps = begun.steps
    still = "" if steps.still is None else f", {steps.still} at rest"
    console.print(
        f"steps: {steps.first} first{still}, {steps.deformed} of largest strain ({strain_text(steps.strain)})",
        soft_wrap=True,
    )
    wall = begun.cpu_s / workers
    lasting = f"{wall:.0f} s" if wall < 100.0 else f"{wall / 60.0:.0f} min"
    console.print(f"{begun.settings} settings, about {lasting}", soft_wrap=True)


def _write_files(found: Tuning, folder: Path) -> list[Path]:
    """The plot, and a table of all settings."""
    from dicflow.io.files import make_folder, write_whole
    from dicflow.io.results import table_text
    from dicflow.views.maps import png
    from dicflow.views.tuning import trial_columns, trial_row, tuning_figure

    make_folder(folder)
    marks = {id(found.present): "present", id(found.choice.trial): "recommended"}
    columns = trial_columns(found)
    rows = [dict(zip(columns, trial_row(marks.get(id(one), ""), one), strict=True)) for one in found.tried]
    contents = {
        folder / "noise_over_resolution.png": png(tuning_figure(found)),
        folder / "settings.csv": table_text(rows).encode(),
    }
    for path, content in contents.items():
        write_whole(path, content)
    return list(contents)


def _print_found(console: Console, found: Tuning, files: list[Path]) -> None:
    from dicflow.tuning.choice import strain_text
    from dicflow.views.console import simple_table
    from dicflow.views.tuning import caliper_words, setting_words, shown_trials, trial_columns, trial_row

    console.print(simple_table(trial_columns(found), [trial_row(*one) for one in shown_trials(found)]))
    for name, trial in (("present", found.present), ("recommended", found.choice.trial)):
        if trial is not None:
            console.print(
                f"{name}: {setting_words(trial)}: VSG {trial.gauge.size}, noise {strain_text(trial.noise)}, "
                f"bias {strain_text(trial.bias)}, together {strain_text(trial.error)}",
                soft_wrap=True,
            )
    if found.caliper is not None:
        console.print(caliper_words(found.caliper), soft_wrap=True)
    lost = f"; {found.left_out} more lose points" if found.left_out else ""
    because = f"because: {found.choice.reason}, of {len(found.tried)} settings{lost}"
    console.print(because if found.choice.trial is not None else found.choice.reason, soft_wrap=True)
    for file in files:
        console.print(str(file), soft_wrap=True)
