"""What the command line shows: progress of a run, plans, tables."""

from __future__ import annotations

import json
import math
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import IO, Any

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from dicflow.engine.journal import STATUSES, Event
from dicflow.engine.plan import Plan
from dicflow.engine.product import Product
from dicflow.errors import ConfigurationError
from dicflow.pipeline.result import Result
from dicflow.views.plain_text import plain, plain_line

__all__ = [
    "Progress",
    "consoles",
    "joined_variants",
    "plan_table",
    "product_tables",
    "products_table",
    "simple_table",
    "why_lines",
]

_FILE_WIDTH = 240


class Progress:
    """Shows a run as it goes: per stage what was cached, computed, failed, and what is left.

    On a terminal the table renews itself, and before it a line counts the files and tasks that are being checked;
    elsewhere one line is printed per finished stage. Warnings are left to the last lines of the command.
    Give :meth:`on_event` to the run, and use the object as a context.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(console=console, refresh_per_second=4) if console.is_terminal else None
        self._stages: dict[str, dict[str, int]] = {}
        self._totals: dict[str, int] = {}
        self._seconds: dict[str, float] = {}
        self._checking = ""
        self._compiling: list[str] = []
        self._started = time.monotonic()

    def __enter__(self) -> Progress:
        if self._live:
            self._live.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        if self._live:
            self._checking = ""
            self._live.transient = not self._stages
            self._live.update(self._shown())
            self._live.__exit__(*error)

    def on_event(self, event: Event) -> None:
        """Handle one event of the run."""
        self._checking = ""
        if event.kind == "checking":
            self._checking = f"checking {event.text}: {event.counts['done']:,} of {event.counts['all']:,}"
        elif event.kind in ("compiling", "compiled"):
            self._compile(event)
        elif event.kind == "planned":
            self._plan(event)
        elif event.kind == "finished":
            self._finish(event)
        elif event.kind in ("dashboard", "waiting"):
            self._console.print(event.text, style="cyan", soft_wrap=True)
        if self._live:
            self._live.update(self._shown())

    def _shown(self) -> Table | Text:
        """The table; before the plan is made, what is being checked."""
        return self._table() if self._stages else Text(plain_line(self._checking))

    def _plan(self, event: Event) -> None:
        self._started = time.monotonic()
        for stage, counts in event.stages.items():
            self._totals[stage] = sum(counts.values())
            self._stages[stage] = dict.fromkeys(STATUSES, 0) | {"hit": counts.get("hit", 0)}
            self._seconds[stage] = 0.0

    def _compile(self, event: Event) -> None:
        if event.kind == "compiled":
            self._compiling.remove(event.stage)
            return
        self._compiling.append(event.stage)
        if not self._live:
            self._console.print(self._compiling_text(), soft_wrap=True)

    def _compiling_text(self) -> str:
        stages = ", ".join(dict.fromkeys(self._compiling))
        return f"compiling for {stages}, once per version" if stages else ""

    def _finish(self, event: Event) -> None:
        counts = self._stages[event.stage]
        counts[event.status] += 1
        self._seconds[event.stage] += event.seconds or 0.0
        if event.status == "failed":
            self._console.print(event.text, style="red", soft_wrap=True)
        elif not self._live and sum(counts.values()) == self._totals[event.stage] and event.status != "skipped":
            self._console.print(
                f"{event.stage}: {_counted(counts)}, {self._seconds[event.stage]:.1f} s", soft_wrap=True
            )

    def _table(self) -> Table:
        table = Table(box=None, pad_edge=False)
        for title in ("stage", *STATUSES, "left", "seconds"):
            table.add_column(plain_line(title), justify="left" if title == "stage" else "right")
        for stage, counts in self._stages.items():
            left = self._totals[stage] - sum(counts.values())
            cells = [str(counts[name] or "·") for name in STATUSES]
            style = "red" if counts["failed"] else "dim" if left else ""
            table.add_row(plain_line(stage), *cells, str(left or "·"), f"{self._seconds[stage]:.1f}", style=style)
        table.caption = self._checking or self._compiling_text() or self._time_left()
        return table

    def _time_left(self) -> str:
        """From the share of the tasks done, at the pace so far."""
        to_do = sum(self._totals.values()) - sum(counts["hit"] for counts in self._stages.values())
        done = sum(counts["computed"] + counts["failed"] for counts in self._stages.values())
        elapsed = time.monotonic() - self._started
        if not done or done >= to_do:
            return f"{elapsed:.0f} s"
        return f"{elapsed:.0f} s, about {elapsed * (to_do - done) / done:.0f} s left"


def joined_variants(event: Event) -> Event:
    """An event of a sweep with all variants of a stage under the stage's own name."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for stage, found in event.stages.items():
        counts[stage.partition("@")[0]].update(found)
    return replace(event, stage=event.stage.partition("@")[0], stages=counts)


def plan_table(plan: Plan) -> Table:
    """Per stage what is cached and what would run, with each reason once and how often it holds."""
    reasons: dict[str, Counter[str]] = defaultdict(Counter)
    for entry in plan.entries.values():
        if entry.state != "hit":
            reasons[entry.task.stage][entry.reason] += 1
    rows = [
        (stage, counts.get("hit", 0), counts.get("run", 0), counts.get("pending", 0), _reasons(reasons[stage]))
        for stage, counts in plan.by_stage().items()
    ]
    return simple_table(("stage", "hit", "run", "waits", "because"), rows)


def why_lines(plan: Plan, name: str) -> Iterator[str]:
    """What has changed for a stage or one of its tasks, in words.

    Raises ConfigurationError for a name that does not exist.
    """
    tasks = [task for task in plan.entries if name in (task, plan.entries[task].task.stage)]
    if not tasks:
        raise ConfigurationError(f"no stage or task '{name}'; stages: {', '.join(plan.graph.stages)}")
    for task in tasks:
        entry = plan.entries[task]
        yield f"{task}: {entry.state if entry.state == 'hit' else entry.reason}"
        for change in plan.why(task) if entry.state == "pending" else ():
            yield f"    {change.text}"


def products_table(result: Result) -> Table:
    """Every stage with the kind it gives, how many of its products the store holds, and its steps."""
    rows = []
    for stage in result.stages:
        steps = result.steps(stage)
        present = sum(result.has(stage, step) for step in steps or (None,))
        named = f"{steps[0]} … {steps[-1]}" if len(steps) > 1 else "".join(steps) or "once"
        rows.append((stage, result.kind(stage), f"{present} of {len(steps) or 1}", named))
    return simple_table(("stage", "gives", "there", "steps"), rows)


def product_tables(product: Product) -> Iterator[Table | str]:
    """The arrays of a product with their ranges, then its attributes as JSON."""
    rows = []
    for name, variable in product.variables.items():
        values = variable.values[np.isfinite(variable.values)] if variable.values.dtype.kind == "f" else variable.values
        low, mean, high = (float(f(values)) for f in (np.min, np.mean, np.max)) if values.size else (math.nan,) * 3
        shape = " × ".join(f"{size} {dim}" for size, dim in zip(variable.values.shape, variable.dims, strict=True))
        rows.append((name, variable.units, str(variable.values.dtype), shape, low, mean, high))
    if rows:
        yield simple_table(("array", "unit", "type", "shape", "least", "mean", "largest"), rows)
    yield json.dumps(dict(product.attrs), indent=1, ensure_ascii=False)


def simple_table(titles: Sequence[str], rows: Sequence[Sequence[Any]]) -> Table:
    """A plain table; numbers stand to the right."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for index, title in enumerate(titles):
        numeric = bool(rows) and all(isinstance(row[index], int | float) for row in rows)
        table.add_column(plain_line(title), justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        table.add_row(*(f"{cell:.4g}" if isinstance(cell, float) else plain_line(cell) for cell in row))
    return table


def _counted(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{number} {name}" for name, number in counts.items() if number) or "nothing to do"


def _reasons(counted: Counter[str]) -> str:
    """The two most common reasons."""
    reasons = [f"{reason} ({count} ×)" if count > 1 else reason for reason, count in counted.most_common(2)]
    return "; ".join(reasons) + ("; …" if len(counted) > 2 else "")


def consoles() -> tuple[Console, Console]:
    """Standard output for results, standard error for progress."""
    return _console(sys.stdout), _console(sys.stderr)


class _PlainConsole(Console):
    """A console that prints text as it is: brackets and colons literally, control characters as escapes."""

    def print(self, *objects: Any, **style: Any) -> None:
        """Print texts and tables."""
        super().print(*(plain(part) if isinstance(part, str) else part for part in objects), **style)


def _console(file: IO[str]) -> Console:
    """A console of plain text; lines to a file or another program are not wrapped."""
    width = None if file.isatty() else _FILE_WIDTH
    return _PlainConsole(file=file, width=width, markup=False, emoji=False, highlight=False)
