"""What the command line shows: plans, tables."""

from __future__ import annotations

import json
import math
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import IO, Any

import numpy as np
from rich.console import Console
from rich.table import Table

from dicflow.discovery import nearest
from dicflow.engine.journal import Event
from dicflow.engine.plan import Plan
from dicflow.engine.product import Product
from dicflow.errors import ConfigurationError
from dicflow.pipeline.result import Result
from dicflow.views.plain_text import plain, plain_line

__all__ = [
    "consoles",
    "joined_variants",
    "plan_table",
    "product_tables",
    "products_table",
    "simple_table",
    "why_lines",
]

_FILE_WIDTH = 240


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
        stages = plan.graph.stages
        raise ConfigurationError(f"no stage or task '{name}'{nearest(name, stages)}; stages: {', '.join(stages)}")
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
