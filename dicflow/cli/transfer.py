"""Commands that carry runs to other machines."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dicflow.cli.options import open_store, refuse_full, say, tick_rarely

if TYPE_CHECKING:
    from dicflow.engine.transfer import Moved

__all__ = ["import_run", "pull", "push"]

StorePath = Annotated[Path, typer.Argument(metavar="STORE", help="folder of the store, such as .dicflow")]
Run = Annotated[str, typer.Argument(metavar="RUN", help="id of a run; default: the newest", show_default=False)]


def push(
    store: StorePath,
    to: Annotated[str, typer.Argument(metavar="TO", help="folder of another store, or s3://BUCKET/FOLDER")],
    run: Run = "latest",
) -> None:
    """Copy a run into another store.

    All its products go along. The store is in a folder, or in a bucket of S3.

    \b
    dicflow push .dicflow s3://laboratory/strip
    dicflow push .dicflow /mnt/share/strip 20260131-101500-ab12cd
    """
    from dicflow.engine import transfer
    from dicflow.engine.store import Store
    from dicflow.io.buckets import is_url, open_bucket

    opened = open_store(store)
    if is_url(to):
        _say(transfer.push(opened, open_bucket(to), run, tick_rarely()), to)
    else:
        _say(transfer.pull(Store.open(to), transfer.Folder(opened.path), run, tick_rarely()), to)


def pull(
    store: StorePath,
    source: Annotated[str, typer.Argument(metavar="FROM", help="folder of another store, or s3://BUCKET/FOLDER")],
    run: Run = "latest",
) -> None:
    """Copy a run out of another store.

    The other store is in a folder, or in a bucket of S3. Every product is compared with its digest. Then a run of the
    same pipeline file with the same photographs measures nothing.

    \b
    dicflow pull .dicflow s3://laboratory/strip
    """
    from dicflow.engine import transfer
    from dicflow.engine.store import Store
    from dicflow.io.buckets import is_url, open_bucket

    origin = open_bucket(source) if is_url(source) else transfer.Folder(Path(source).absolute())
    _say(transfer.pull(Store.open(store), origin, run, tick_rarely()), store)


def import_run(
    crate: Annotated[Path, typer.Argument(metavar="CRATE", help="folder that 'dicflow export --format crate' wrote")],
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="new folder for its files and products")],
) -> None:
    """Take in a crate.

    The new folder has the pipeline file, the photographs, and every product of the run.

    \b
    dicflow import export/pipeline.crate strip
    dicflow run strip/pipeline.yaml
    """
    from dicflow.pipeline.crate import import_crate

    refuse_full(folder, force=False)
    pipeline, moved = import_crate(crate, folder, tick_rarely())
    _say(moved, folder)
    say(f"next: {shlex.join(['dicflow', 'run', str(pipeline)])}")


def _say(moved: Moved, place: object) -> None:
    say(f"run {moved.run}: {moved.products} products in {place}, {moved.new} of them new ({moved.nbytes / 1e6:.1f} MB)")
