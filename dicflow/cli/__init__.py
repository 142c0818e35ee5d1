"""The command line. Exit codes: 0 ok, 1 some stages failed, 2 bad configuration, 130 interrupted.

Worker processes import this module again, as the program that they belong to; so the commands are loaded only by
:func:`main`.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading

__all__ = ["main"]


def main() -> None:
    """Run the command line; every error meant for users is one message, without a traceback."""
    from dicflow.engine.workers import collect_rarely, limit_threads, with_room

    collect_rarely()
    import typer

    from dicflow.cli.commands import app
    from dicflow.engine.kernel_cache import keep_kernels
    from dicflow.errors import DicflowError
    from dicflow.views.plain_text import ascii_signs, plain
    from dicflow.views.topics import advice, topic_raised

    limit_threads()
    keep_kernels()
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the caller
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        ascii_signs(getattr(sys, name))
    _end_in_order()
    try:
        with_room(app)
    except DicflowError as error:
        typer.secho(plain(error), fg="red", err=True)
        typer.echo(advice([topic_raised(error.__traceback__)]), err=True)
        sys.exit(error.exit_code)
    finally:
        gc.freeze()  # the system takes the memory back; doing so object by object costs a quarter of a second


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
