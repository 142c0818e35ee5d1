"""Commands that maintain a store."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dicflow.cli.options import open_store

__all__ = ["gc", "pin", "verify"]


def gc(
    store: Annotated[Path, typer.Argument(metavar="STORE", help="folder of the store, such as .dicflow")],
    keep_runs: Annotated[int, typer.Option(min=0, help="newest runs of each pipeline that keep their products")] = 5,
    delete: Annotated[bool, typer.Option("--delete", help="delete it; without this only say what would go")] = False,
) -> None:
    """Delete products that no recent run and no pin needs.

    \b
    dicflow gc .dicflow
    dicflow gc .dicflow --keep-runs 1 --delete
    """
    from dicflow.engine.housekeeping import collect

    garbage = collect(open_store(store), keep_runs=keep_runs, delete=delete)
    verb = "freed" if delete else "would free"
    typer.echo(
        f"{verb} {garbage.nbytes / 1e6:.1f} MB: {len(garbage.objects)} products, {len(garbage.records)} records, "
        f"{len(garbage.runs)} runs" + ("" if delete else "; add --delete to do it")
    )


def verify(
    store: Annotated[Path, typer.Argument(metavar="STORE", help="folder of the store, such as .dicflow")],
    repair: Annotated[
        bool, typer.Option("--repair", help="set damaged products aside, so that they are made again")
    ] = False,
) -> None:
    """Compare every product of a store with its digest.

    \b
    dicflow verify .dicflow
    """
    from dicflow.engine import housekeeping

    damages = housekeeping.verify(open_store(store), repair=repair)
    for damage in damages:
        typer.echo(f"{damage.what}: {damage.reason}")
    typer.echo(
        "nothing is damaged"
        if not damages
        else f"{len(damages)} damaged{', set aside' if repair else '; add --repair'}"
    )
    raise typer.Exit(1 if damages else 0)


def pin(
    store: Annotated[Path, typer.Argument(metavar="STORE", help="folder of the store, such as .dicflow")],
    run_id: Annotated[
        str | None, typer.Argument(metavar="RUN", help="id of a run; without it the runs and their pins are listed")
    ] = None,
    note: Annotated[str, typer.Option(help="why it is kept")] = "",
    remove: Annotated[bool, typer.Option("--remove", help="take the pin away")] = False,
) -> None:
    """Keep the products of a run; gc does not free them.

    \b
    dicflow pin .dicflow
    dicflow pin .dicflow 20260131-101500-ab12 --note "figures of the paper"
    """
    from dicflow.engine import housekeeping
    from dicflow.engine.journal import runs

    opened = open_store(store)
    if run_id is None:
        kept = housekeeping.pins(opened)
        for info in runs(opened):
            typer.echo(f"{info.id}  {info.pipeline}" + (f"  pinned: {kept[info.id]}" if info.id in kept else ""))
    elif remove:
        housekeeping.unpin(opened, run_id)
    else:
        housekeeping.pin(opened, run_id, note)
