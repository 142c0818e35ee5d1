"""Commands that pass a measurement on: its report, its files, its differences from another."""

from __future__ import annotations

import json
import os
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperOption

from dicflow.cli.options import (
    Command,
    Data,
    Force,
    PipelineFile,
    Settings,
    Step,
    StoreFolder,
    VariantNumber,
    load,
    refuse_existing,
    results_folder,
    say,
    stored,
    tick_rarely,
    variant_index,
    write_new,
)
from dicflow.errors import ConfigurationError

if TYPE_CHECKING:
    from dicflow.comparison.difference import Comparison
    from dicflow.pipeline import Pipeline

__all__ = ["ExportCommand", "compare", "export", "report"]


class Locale(StrEnum):
    """How spreadsheets of a language write numbers."""

    en = "en"
    de = "de"


_CRATE, _CRATE_WORDS = "crate", "an RO-Crate of the last run, with its files and products, for 'dicflow import'"
_SIDE = "pipeline file, id of a run, or table of points; #2 behind it chooses the second variant"
Quantities = Annotated[
    list[str],
    typer.Option(
        "--quantity", default_factory=list, show_default=False, metavar="NAME", help="repeatable; default: all"
    ),
]


def report(
    pipeline: PipelineFile,
    settings: Settings,
    data: Data = None,
    store: StoreFolder = None,
    output: Annotated[
        Path | None, typer.Option(help="folder for the report; default: results/NAME beside the file")
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="drawn at once; default: one per core")] = os.cpu_count() or 1,
    pdf: Annotated[bool, typer.Option("--pdf", help="also as PDF, through Chromium, Chrome or Edge")] = False,
    appendix: Annotated[
        bool, typer.Option("--appendix", help="with --pdf: calibration, quality, provenance too")
    ] = False,
    methods: Annotated[bool, typer.Option("--methods", help="print a methods paragraph for a paper instead")] = False,
) -> None:
    """Write the report of what the store holds; nothing is measured.

    \b
    dicflow report pipeline.yaml
    dicflow report pipeline.yaml --pdf
    dicflow report pipeline.yaml --pdf --appendix
    dicflow report pipeline.yaml --methods
    """
    from dicflow.report.build import write_report
    from dicflow.report.paper import write_pdf
    from dicflow.report.paragraph import methods_paragraph

    if appendix and not pdf:
        raise ConfigurationError("--appendix prints more of a PDF; add --pdf")
    loaded = load(pipeline, data, store, settings)
    if methods:
        say(methods_paragraph(loaded, stored(loaded)))
        return
    folder = results_folder(loaded, output)
    page = write_report(loaded, stored(loaded), folder, workers, partial(say, error=True))
    say(page)
    if pdf:
        say(write_pdf(page, appendix))


class ExportCommand(Command):
    """The command ``export``, whose help lists the formats, which are found when the help is printed."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        for option in self.params:
            if isinstance(option, TyperOption) and option.name == "to":
                option.help = _format_words()
        super().format_help(ctx, formatter)


def _format_words() -> str:
    """Each description with its formats."""
    from dicflow.io.exports import descriptions
    from dicflow.views.exported_pictures import PICTURES

    formats: dict[str, list[str]] = {}
    for name, text in {**descriptions(), **{name: picture.description for name, picture in PICTURES.items()}}.items():
        formats.setdefault(text, []).append(name)
    return "; ".join(f"{', '.join(names)}: {text}" for text, names in {**formats, _CRATE_WORDS: [_CRATE]}.items())


def export(
    pipeline: PipelineFile,
    settings: Settings,
    quantities: Quantities,
    stage: Annotated[str | None, typer.Argument(help="stage to write; default: the whole test")] = None,
    step: Step = None,
    to: Annotated[str, typer.Option("--format", help="format of the files")] = "csv",
    output: Annotated[Path, typer.Option(help="folder for the files")] = Path("export"),
    data: Data = None,
    store: StoreFolder = None,
    variant: VariantNumber = 1,
    digits: Annotated[int, typer.Option(min=1, max=17, help="significant, of numbers in CSV and xlsx; 17 for all")] = 6,
    locale: Annotated[Locale, typer.Option(help="de: decimal commas and semicolons in CSV")] = Locale.en,
    force: Force = False,
) -> None:
    """Write a whole test, or one stage, for other programs.

    Without a stage: every total, and beside it the tables, the region and the rig; a workbook (xlsx) has the points of
    one step, that of --step or of the largest strain.

    \b
    dicflow export pipeline.yaml
    dicflow export pipeline.yaml --format xlsx
    dicflow export pipeline.yaml total --format xlsx
    dicflow export pipeline.yaml --format hdf5 --output exported
    dicflow export pipeline.yaml total --step step_03 --quantity eyy --format png
    dicflow export pipeline.yaml total --quantity eyy --format mp4
    dicflow export pipeline.yaml total --step step_03 --quantity W --format surface
    dicflow export pipeline.yaml --format crate
    """
    from dicflow.io.table import LOCALES
    from dicflow.views.exports import Selection
    from dicflow.views.exports import export as write

    loaded = load(pipeline, data, store, settings)
    if to == _CRATE:
        _refuse_choice(settings, stage, step, quantities, variant)
        say(_crate(loaded, output, force))
        return
    result, style = stored(loaded), LOCALES[locale]._replace(digits=digits)
    paths = write(
        result,
        output,
        Selection(stage, step, tuple(quantities), variant_index(result, variant), style),
        to=to,
        force=force,
        name=loaded.name,
        note=partial(say, error=True),
    )
    for path in paths:
        say(path)


def _refuse_choice(settings: list[str], *chosen: object) -> None:
    if settings or any(chosen[:-1]) or chosen[-1] != 1:
        raise ConfigurationError(
            "a crate holds the whole run of the pipeline file as it is; write --set into the file, and name no stage, "
            "step, quantity or variant"
        )


def _crate(pipeline: Pipeline, output: Path, force: bool) -> Path:
    from dicflow.pipeline.crate import write_crate
    from dicflow.report.paragraph import methods_paragraph

    return write_crate(pipeline, str(methods_paragraph(pipeline, stored(pipeline))), output, force, tick_rarely())


def compare(
    a: Annotated[str, typer.Argument(metavar="A", help=_SIDE)],
    b: Annotated[str, typer.Argument(metavar="B", help="the same, of the other side")],
    quantities: Quantities,
    step: Step = None,
    data: Data = None,
    store: Annotated[
        Path | None, typer.Option(help="folder of the products; default: .dicflow beside the file, or the other one")
    ] = None,
    output: Annotated[Path | None, typer.Option(help="HTML file to write; default: text alone")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="one line of JSON in place of text")] = False,
    force: Force = False,
) -> None:
    """Compare two measurements.

    \b
    dicflow compare pipeline.yaml other.yaml
    dicflow compare "pipeline.yaml#1" "pipeline.yaml#2" --quantity eyy
    dicflow compare pipeline.yaml reference.csv --step step_03 --output difference.html
    """
    from dicflow.comparison.difference import compare as compared
    from dicflow.comparison.sides import open_sides

    if output is not None:
        if output.suffix.lower() not in (".html", ".htm"):
            raise ConfigurationError(f"{output}: a comparison is written as .html; for other kinds --json prints it")
        refuse_existing(output, force)
    found = compared(*open_sides(a, b, store, data), (step,) if step else (), quantities)
    if output is not None:
        from dicflow.report.difference import difference_page

        write_new(output, difference_page(found), force)
    if as_json:
        say(json.dumps(found.to_json()))
    else:
        _say(found)


def _say(found: Comparison) -> None:
    """Settings and statistics as text."""
    from dicflow.report.difference import COLUMNS, difference_rows
    from dicflow.views.console import consoles, simple_table

    console, _ = consoles()
    lines = [f"A  {found.a}", f"B  {found.b}", *found.notes, ""]
    if found.changes:
        lines += ["settings, A → B", *(f"  {change.text}" for change in found.changes), ""]
    console.print("\n".join(lines if found.differs else [*lines, "no difference", ""]))
    console.print("fields, A − B")
    console.print(simple_table(COLUMNS, difference_rows(found)))
