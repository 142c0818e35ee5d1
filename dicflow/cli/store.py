"""Commands that maintain a store."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dicflow.cli.options import open_store, say
from dicflow.views.plain_text import plain_line

if TYPE_CHECKING:
    from dicflow.engine.layout import Part

__all__ = ["gc", "pin", "verify"]

_COUNTED: Mapping[str, tuple[Part, ...]] = {
    "products": ("manifest", "group"),
    "records": ("record",),
    "runs": ("run",),
    "definitions": ("code",),
    "left by killed processes": ("draft",),
    "set aside": ("set aside",),
}


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

    opened = open_store(store)
    garbage = collect(opened, keep_runs=keep_runs, delete=delete)
    for path in garbage.foreign:
        say(plain_line(f"left alone, since the store did not make it: {path.relative_to(opened.path)}"), error=True)
    if not delete:
        for found in garbage.found:
            say(plain_line(f"{found.part}  {found.path.relative_to(opened.path)}"))
    listed = ", ".join(f"{len(garbage.names(*parts))} {word}" for word, parts in _COUNTED.items())
    verb = "freed" if delete else "would free"
    say(f"{verb} {garbage.nbytes / 1e6:.1f} MB: {listed}" + ("" if delete else "; add --delete to do it"))


def verify(
    store: Annotated[Path, typer.Argument(metavar="STORE", help="folder of the store, such as .dicflow")],
    repair: Annotated[
        bool, typer.Option("--repair", help="set aside what is damaged, so that it is made again")
    ] = False,
) -> None:
    """Read every file of a store and name what is damaged.

    \b
    dicflow verify .dicflow
    """
    from dicflow.engine.store import Store
    from dicflow.engine.verification import verify as verified

    damages = verified(Store.open(store, create=False, accept_damaged=True), repair=repair)
    for damage in damages:
        say(plain_line(f"{damage.what}: {damage.reason}"))
    count = Counter(damage.state for damage in damages)
    repaired = sum(damage.repaired for damage in damages)
    parts = [
        f"{count['damaged']} damaged" + (f", {repaired} of them set aside" if repair else "; add --repair"),
        f"{count['unreadable']} cannot be read; get read access",
    ]
    shown = [part for part in parts if not part.startswith("0 ")]
    say("; ".join(shown) or "nothing is damaged")
    raise typer.Exit(1 if shown else 0)


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
            say(f"{info.id}  {info.pipeline}" + (f"  pinned: {kept[info.id]}" if info.id in kept else ""))
    elif remove:
        housekeeping.unpin(opened, run_id)
    else:
        housekeeping.pin(opened, run_id, note)
