"""Arguments and options of several commands, and how files are opened and written."""

from __future__ import annotations

import time
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from dicflow.errors import ConfigurationError
from dicflow.views.plain_text import plain, plain_line

if TYPE_CHECKING:
    from dicflow.engine.store import Store
    from dicflow.pipeline import Pipeline, Result

__all__ = [
    "CodePolicy",
    "Command",
    "Data",
    "Force",
    "Output",
    "PipelineFile",
    "Policy",
    "Settings",
    "Step",
    "StoreFolder",
    "VariantNumber",
    "load",
    "open_store",
    "refuse_existing",
    "refuse_full",
    "results_folder",
    "say",
    "stored",
    "tick",
    "tick_rarely",
    "variant_index",
    "warn",
    "write_new",
]


_SILENCE_S = 2.0


class CodePolicy(StrEnum):
    """Treatment of products whose stage has been edited since."""

    recompute = "recompute"
    warn = "warn"
    ignore = "ignore"


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
        show_default=False,
        metavar="STAGE.PARAMETER=VALUE",
        help="another value; several, v1,v2,v3, make a sweep",
    ),
]
Output = Annotated[
    Path | None, typer.Option(help="folder for maps, tables, report; default: results/NAME beside the file")
]
Policy = Annotated[CodePolicy, typer.Option(help="for products of code that has changed since")]
Step = Annotated[str | None, typer.Option(help="name of the step; default: every step")]
Force = Annotated[bool, typer.Option("--force", help="overwrite files that exist")]
VariantNumber = Annotated[int, typer.Option("--variant", min=1, help="number of the sweep's variant")]


def say(text: object, *, error: bool = False) -> None:
    """Print a text as it is, on standard error if it is beside the result."""
    typer.echo(plain(text), err=error)


def warn(text: str) -> None:
    typer.secho(f"warning: {plain_line(text)}", fg="yellow", err=True)


def load(pipeline: Path, data: Path | None, store: Path | None, settings: list[str]) -> Pipeline:
    from dicflow.pipeline import Pipeline

    return Pipeline.load(pipeline, data=data, store=store, settings=settings)


def stored(pipeline: Pipeline) -> Result:
    """The result that the store holds of a pipeline; notes on standard error name its source if it matters."""
    result = pipeline.result()
    for note in result.notes:
        warn(note)
    return result


def results_folder(pipeline: Pipeline, output: Path | None) -> Path:
    """The folder of maps, tables and the report."""
    return output or pipeline.path.parent / "results" / pipeline.name


class Command(TyperCommand):
    """A command that says what to do where a value with a blank lacks its quotes."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except Exception as error:
            if "unexpected extra argument" in getattr(error, "message", ""):
                error.message += '; a value with a blank needs quotes, as in "14.5 mm"'  # type: ignore[attr-defined]
            raise


def open_store(folder: Path) -> Store:
    from dicflow.engine.store import Store

    return Store.open(folder, create=False)


def tick(done: int, total: int, name: str) -> None:
    say(f"{done}/{total} {name}", error=True)


def tick_rarely() -> Callable[[int, int, str], None]:
    """A :func:`tick` that says something every two seconds at most."""
    said = time.monotonic()

    def rarely(done: int, total: int, name: str) -> None:
        nonlocal said
        if time.monotonic() - said >= _SILENCE_S:
            said = time.monotonic()
            tick(done, total, name)

    return rarely


def refuse_full(folder: Path, force: bool) -> None:
    if folder.is_dir() and any(folder.iterdir()) and not force:
        raise ConfigurationError(f"{folder} is not empty; name another folder or add --force")


def write_new(path: Path, content: bytes, force: bool) -> None:
    """Write a file as a whole."""
    from dicflow.io.files import write_whole

    refuse_existing(path, force)
    write_whole(path, content)


def refuse_existing(path: Path, force: bool, other: str = "name another") -> None:
    if path.exists() and not force:
        raise ConfigurationError(f"{path} exists; add --force to overwrite it, or {other}")


def variant_index(result: Result, variant: int) -> int:
    """The index of a variant that the user counts from 1."""
    if variant > len(result.values):
        raise ConfigurationError(f"--variant {variant}: there are {len(result.values)}, counted from 1")
    return variant - 1
