"""The command app: a measurement in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dicflow.cli.options import Data, StoreFolder, say

__all__ = ["app"]


def app(
    path: Annotated[
        Path, typer.Argument(metavar="[FOLDER | PIPELINE]", help="folder of one test, or its pipeline file")
    ] = Path("."),
    data: Data = None,
    store: StoreFolder = None,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="print the link, and open no browser")] = False,
    port: Annotated[int, typer.Option(min=0, max=65535, help="port on 127.0.0.1; 0 takes a free one")] = 0,
) -> None:
    """See, draw and ask in the browser.

    It edits the pipeline file and its region, and starts runs, which go on when the app ends.

    \b
    dicflow app experiment
    dicflow app pipeline.yaml --no-browser
    """
    from dicflow.app.project import open_project
    from dicflow.app.server import serve
    from dicflow.io.edited_yaml import require_editor

    require_editor()
    project = open_project(path, data, store)
    serve(project, _say_link, opens=not no_browser, port=port)


def _say_link(link: str) -> None:
    say(link)
    say("open this link, which is for you alone; Ctrl-C ends the app, and runs go on", error=True)
