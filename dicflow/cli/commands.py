"""The commands by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import typer

from dicflow._version import __version__
from dicflow.cli.app import app as browser_app
from dicflow.cli.hand_over import ExportCommand, compare, export, report
from dicflow.cli.measure import plan, run, why
from dicflow.cli.options import Command
from dicflow.cli.products import graph, list_products, show
from dicflow.cli.store import gc, pin, verify
from dicflow.cli.tools import demo, doctor, help_topics, init, schema, stages, synth, warm
from dicflow.cli.transfer import import_run, pull, push
from dicflow.cli.tune import tune
from dicflow.cli.watch import watch

__all__ = ["app"]

app = typer.Typer(
    name="dicflow",
    help="Full-field displacement and strain from photographs of two cameras.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
COMMANDS: dict[str, Callable[..., None]] = {
    "run": run,
    "watch": watch,
    "plan": plan,
    "why": why,
    "tune": tune,
    "graph": graph,
    "ls": list_products,
    "show": show,
    "report": report,
    "export": export,
    "import": import_run,
    "push": push,
    "pull": pull,
    "compare": compare,
    "gc": gc,
    "verify": verify,
    "pin": pin,
    "stages": stages,
    "schema": schema,
    "init": init,
    "app": browser_app,
    "demo": demo,
    "doctor": doctor,
    "help": help_topics,
    "warm": warm,
}
CLASSES: dict[str, type[Command]] = {"export": ExportCommand}
for name, command in COMMANDS.items():
    app.command(name, cls=CLASSES.get(name, Command))(command)
app.add_typer(synth, name="synth")


@app.callback(invoke_without_command=True)
def root(version: Annotated[bool, typer.Option("--version", help="print the version")] = False) -> None:
    if version:
        typer.echo(f"dicflow {__version__}")
        raise typer.Exit
