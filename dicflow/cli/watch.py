"""The command watch: a test that is measured while it runs."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated

import typer

from dicflow.cli.measure import compute_and_write
from dicflow.cli.options import Data, Output, PipelineFile, Settings, StoreFolder, load, results_folder, say

if TYPE_CHECKING:
    from dicflow.pipeline import Pipeline
    from dicflow.pipeline.watching import Measured

__all__ = ["serve", "watch"]


def watch(
    pipeline: PipelineFile,
    settings: Settings,
    data: Data = None,
    store: StoreFolder = None,
    output: Output = None,
    workers: Annotated[int, typer.Option(min=1, help="workers at once; default: one per core")] = os.cpu_count() or 1,
    page: Annotated[
        bool, typer.Option("--page", help="serve a page with curve and maps, for you alone, and print its link")
    ] = False,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="draw no maps at the end")] = False,
    no_report: Annotated[bool, typer.Option("--no-report", help="write no report at the end")] = False,
) -> None:
    """Measure each photograph or pair as it comes.

    A line per step gives the values of the probes. Ctrl-C ends it; then it does what run does, pictures and report.

    \b
    dicflow watch pipeline.yaml
    dicflow watch pipeline.yaml --page
    """
    from dicflow.engine.execute import interruptible
    from dicflow.engine.phases import Phases
    from dicflow.io.files import make_folder
    from dicflow.pipeline.watching import Watch

    loaded = load(pipeline, data, store, settings)
    folder = results_folder(loaded, output)
    make_folder(folder)
    watched = Watch(loaded, _print_step, _note, workers)
    with _page_of(loaded) if page else _nothing():
        _note("watching; Ctrl-C ends it and writes pictures and report")
        with interruptible(watched.end):
            watched.run()
    _, code = compute_and_write(
        watched.pipeline_so_far(), folder, Phases(), pictures=not no_pictures, report=not no_report, workers=workers
    )
    raise typer.Exit(code)


def _note(text: str) -> None:
    say(text, error=True)


def _print_step(measured: Measured) -> None:
    """One line: the step, the values of the probes, and how long after its photographs."""
    from dicflow.kinds.probes import main_readings
    from dicflow.views.variant_names import variant_names

    readings = [
        (" ".join([*variant_names([row.get("variant", {})]), row["probe"]]).strip(), *one)
        for row in measured.readings
        for one in main_readings(row)
    ]
    values = ", ".join(f"{probe} {quantity} {_number(value, u)}" for probe, quantity, value, u in readings)
    words = "; ".join(filter(None, [values, *measured.problems])) or "measured"
    say(f"{measured.step}: {words} ({measured.after_s:.1f} s after the photograph)")


def _number(value: float | None, u: float | None) -> str:
    """A value with its uncertainty, to two digits of it."""
    if value is None:
        return "unknown"
    if not u:
        return f"{value:.6g}"
    digits = max(0, 1 - math.floor(math.log10(u)))
    return f"{value:.{digits}f} ± {u:.{digits}f}"


@contextmanager
def _nothing() -> Iterator[None]:
    yield


@contextmanager
def _page_of(pipeline: Pipeline) -> Iterator[None]:
    """The app on this pipeline, in a process of its own, as long as the watch goes on. Its first line is the link."""
    from dicflow.io.edited_yaml import require_editor

    require_editor()
    command = [sys.executable, "-c", f"from {__name__} import serve; serve()", "app", str(pipeline.path.absolute())]
    command += ["--no-browser", "--data", str(pipeline.folder), "--store", str(pipeline.store_folder)]
    app = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                           text=True, start_new_session=True)  # fmt: skip
    threading.Thread(target=_say_link, args=(app,), daemon=True).start()
    try:
        yield
    finally:
        app.terminate()
        app.wait()


def serve() -> None:
    """The command line in a process that ends with the one that started it, however that ends: its input does."""
    from dicflow.cli import main

    def end() -> None:
        sys.stdin.read()
        os._exit(0)

    threading.Thread(target=end, daemon=True).start()
    main()


def _say_link(app: subprocess.Popen[str]) -> None:
    """Print the link once the app serves; where it ends before by itself, how to learn why."""
    assert app.stdout is not None
    link = app.stdout.readline().strip()
    if link:
        _note(f"open {link}#explore for the curve and the maps; the link is for you alone")
    elif app.wait() > 0:
        _note("--page: the app did not start; run 'dicflow app' on this pipeline file to see why")
