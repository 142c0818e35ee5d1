"""The table of where the time of a run goes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.table import Table

from dicflow.pipeline.profile import Share
from dicflow.views.plain_text import plain_line

__all__ = ["profile_json", "profile_table"]


def profile_table(shares: Sequence[Share]) -> Table:
    """Each part of the time in a line, their sums in the last; times in seconds."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("where the time goes")
    for title in ("tasks", "wall s", "CPU s"):
        table.add_column(title, justify="right")
    for share in shares:
        tasks = "" if share.tasks is None else str(share.tasks)
        table.add_row(plain_line(share.name), tasks, _seconds(share.wall_s), _seconds(share.cpu_s))
    wall_s, cpu_s = _sums(shares)
    table.add_row("all", "", _seconds(wall_s), _seconds(cpu_s), style="bold")
    return table


def profile_json(shares: Sequence[Share]) -> dict[str, Any]:
    """The same for programs; times in seconds."""
    wall_s, cpu_s = _sums(shares)
    parts = [
        {
            "name": share.name.strip(),
            "tasks": share.tasks,
            "wall_s": None if share.wall_s is None else round(share.wall_s, 4),
            "cpu_s": round(share.cpu_s, 4),
        }
        for share in shares
    ]
    return {"wall_s": round(wall_s, 4), "cpu_s": round(cpu_s, 4), "parts": parts}


def _sums(shares: Sequence[Share]) -> tuple[float, float]:
    return sum(share.wall_s or 0.0 for share in shares), sum(share.cpu_s for share in shares)


def _seconds(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"
