"""The command line. Exit codes: 0 ok, 1 some stages failed, 2 bad configuration, 130 interrupted."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import Annotated

import typer
from typer.core import TyperCommand

from dicflow._version import __version__
from dicflow.cli.hand_over import ExportCommand, compare, export, report
from dicflow.cli.measure import plan, run, why
from dicflow.cli.products import graph, list_products, show
from dicflow.cli.store import gc, pin, verify
from dicflow.cli.tools import doctor, init, schema, stages, synth
from dicflow.errors import DicflowError

__all__ = ["app", "main"]

app = typer.Typer(
    name="dicflow",
    help="Full-field displacement and strain from photographs of two cameras.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
COMMANDS: dict[str, Callable[..., None]] = {
    "run": run,
    "plan": plan,
    "why": why,
    "graph": graph,
    "ls": list_products,
    "show": show,
    "report": report,
    "export": export,
    "compare": compare,
    "gc": gc,
    "verify": verify,
    "pin": pin,
    "stages": stages,
    "schema": schema,
    "init": init,
    "doctor": doctor,
}
CLASSES: dict[str, type[TyperCommand]] = {"export": ExportCommand}
for name, command in COMMANDS.items():
    app.command(name, cls=CLASSES.get(name))(command)
app.add_typer(synth, name="synth")


@app.callback(invoke_without_command=True)
def root(version: Annotated[bool, typer.Option("--version", help="print the version")] = False) -> None:
    if version:
        typer.echo(f"dicflow {__version__}")
        raise typer.Exit


def main() -> None:
    """Run the command line; every error meant for users is one message, without a traceback."""
    from dicflow.engine.kernel_cache import keep_kernels
    from dicflow.engine.workers import limit_threads
    from dicflow.views.plain_text import ascii_signs, plain

    limit_threads()
    keep_kernels()
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the caller
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        ascii_signs(getattr(sys, name))
    _end_in_order()
    try:
        app()
    except DicflowError as error:
        typer.secho(plain(error), fg="red", err=True)
        sys.exit(error.exit_code)


def _end_in_order() -> None:
    """Let a signal to end, or the loss of the terminal, end the workers too; one that is ignored stays so."""
    if threading.current_thread() is not threading.main_thread():
        return
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _end)


def _end(number: int, _frame: object) -> None:
    sys.exit(128 + number)
