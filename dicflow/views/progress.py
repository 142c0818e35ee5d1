"""Progress of a run on the screen: what each stage has done, a bar, and the time left, with pictures and report."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from dicflow.engine.journal import STATUSES, Event
from dicflow.views.plain_text import plain_line

__all__ = ["Progress"]

_SILENT_S = 2.0
"""Longest time without a sign of life."""
_BAR_WIDTH = 32


class Progress:
    """Shows a run as it goes: per stage what was cached, computed, failed, and what is left, and how long it takes.

    On a terminal a table and a bar renew themselves; elsewhere one line is printed per finished stage, and one with the
    share done and the time left whenever nothing else was printed for two seconds. Warnings are left to the last lines
    of the command. Give :meth:`on_event` to the run, :meth:`drawing` to what draws, and use the object as a context.

    afterwards : what is drawn after the tasks → time that it may take [s]
    """

    def __init__(self, console: Console, afterwards: Mapping[str, float] | None = None) -> None:
        self._console = console
        self._stages: dict[str, dict[str, int]] = {}
        self._totals: dict[str, int] = {}
        self._seconds: dict[str, float] = {}
        self._drawings = {what: _Drawing(seconds) for what, seconds in (afterwards or {}).items()}
        self._checking = ""
        self._compiling: list[str] = []
        self._started = self._printed = time.monotonic()
        self._share = 0.0
        self._ended = threading.Event()
        self._ticker = threading.Thread(target=self._tick, daemon=True)
        self._live: Live | None = None
        if console.is_terminal:
            self._live = Live(console=console, refresh_per_second=4, get_renderable=self._shown)

    def __enter__(self) -> Progress:
        if self._live:
            self._live.__enter__()
        else:
            self._ticker.start()
        return self

    def __exit__(self, *error: Any) -> None:
        self._ended.set()
        if self._live:
            self._checking = ""
            self._live.transient = not self._stages
            self._live.__exit__(*error)
        else:
            self._ticker.join()

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
            self._print(event.text, style="cyan")

    def drawing(self, what: str) -> Callable[[int, int], None]:
        """A function that takes how many parts of something are drawn, and of how many."""
        drawing = self._drawings.setdefault(what, _Drawing(0.0))

        def note(done: int, count: int) -> None:
            drawing.note(done, count)
            if done == count and not self._live and count:
                self._print(f"{what}: {count} parts, {drawing.lasted:.1f} s")

        return note

    def _print(self, text: str, style: str = "") -> None:
        self._printed = time.monotonic()
        self._console.print(text, style=style or None, soft_wrap=True)

    def _tick(self) -> None:
        """Print a line whenever none was printed for a while; of a plan only where there is much to check."""
        while not self._ended.wait(0.1):
            if (self._stages or self._checking) and time.monotonic() - self._printed >= _SILENT_S:
                self._print(self._line())

    def _line(self) -> str:
        """What goes on now, the share done, and the time left."""
        if not self._stages:
            return self._checking
        now = self._compiling_text() or next(self._under_way(), "working")
        return f"{now}: {100 * self._done():.0f} %, {self._times()}"

    def _under_way(self) -> Iterator[str]:
        """Drawings and stages under way, in words."""
        yield from (f"{name} {one.done} of {one.count}" for name, one in self._drawings.items() if one.is_under_way)
        for name, counts in self._stages.items():
            done = sum(counts.values())
            if counts["hit"] < done < self._totals[name]:
                yield f"{name} {done} of {self._totals[name]}"

    def _shown(self) -> RenderableType:
        """The table and the bar; before the plan is made, what is being checked."""
        if not self._stages:
            return Text(plain_line(self._checking))
        bar = Table.grid(padding=(0, 1))
        share = self._done()
        texts = plain_line(f"{100 * share:.0f} %"), plain_line(self._times()), plain_line(self._compiling_text())
        bar.add_row(ProgressBar(total=1.0, completed=share, width=_BAR_WIDTH), *texts)
        return Group(self._table(), bar)

    def _plan(self, event: Event) -> None:
        """Take in a plan; the stages last and at once, since another thread draws them."""
        self._started = time.monotonic()
        self._totals = {stage: sum(counts.values()) for stage, counts in event.stages.items()}
        self._seconds = dict.fromkeys(event.stages, 0.0)
        self._stages = {
            stage: dict.fromkeys(STATUSES, 0) | {"hit": counts.get("hit", 0)} for stage, counts in event.stages.items()
        }

    def _compile(self, event: Event) -> None:
        if event.kind == "compiled":
            self._compiling.remove(event.stage)
            return
        self._compiling.append(event.stage)
        if not self._live:
            self._print(self._compiling_text())

    def _compiling_text(self) -> str:
        stages = ", ".join(dict.fromkeys(self._compiling))
        return f"compiling for {stages}, once per version" if stages else ""

    def _finish(self, event: Event) -> None:
        counts = self._stages[event.stage]
        counts[event.status] += 1
        self._seconds[event.stage] += event.seconds or 0.0
        if event.status == "failed":
            self._print(event.text, style="red")
        elif not self._live and sum(counts.values()) == self._totals[event.stage] and event.status != "skipped":
            self._print(f"{event.stage}: {_counted(counts)}, {self._seconds[event.stage]:.1f} s")

    def _table(self) -> Table:
        table = Table(box=None, pad_edge=False)
        for title in ("stage", *STATUSES, "left", "seconds"):
            table.add_column(plain_line(title), justify="left" if title == "stage" else "right")
        for stage, counts in self._stages.items():
            left = self._totals[stage] - sum(counts.values())
            cells = [str(counts[name] or "·") for name in STATUSES]
            style = "red" if counts["failed"] else "dim" if left else ""
            table.add_row(plain_line(stage), *cells, str(left or "·"), f"{self._seconds[stage]:.1f}", style=style)
        for name, one in self._drawings.items():
            cells = [*("·" * len(STATUSES)), str(one.count - one.done or "·")]
            table.add_row(plain_line(name), *cells, f"{one.lasted:.1f}", style="" if one.count == one.done else "dim")
        return table

    def _done(self) -> float:
        """Share of the whole run that is done; it never falls."""
        elapsed, left = time.monotonic() - self._started, self._left()
        if left is not None:
            self._share = max(self._share, elapsed / max(elapsed + left, 1e-9))
        return self._share

    def _times(self) -> str:
        elapsed, left = time.monotonic() - self._started, self._left()
        return f"{_clock(elapsed)}, about {_clock(left)} left" if left else _clock(elapsed)

    def _left(self) -> float | None:
        """Time left [s] at the pace so far, also for what is drawn; None while nothing tells it."""
        tasks = self._tasks_left()
        return None if tasks is None else tasks + sum(one.left for one in self._drawings.values())

    def _tasks_left(self) -> float | None:
        """Time left for the tasks [s]; a stage of which none is done yet is taken for one like the others."""
        ran = {name: counts["computed"] + counts["failed"] for name, counts in self._stages.items()}
        left = {name: self._totals[name] - sum(counts.values()) for name, counts in self._stages.items()}
        if not any(left.values()):
            return 0.0
        spent, number = sum(self._seconds.values()), sum(ran.values())
        if spent <= 0.0:
            return None
        each = {name: self._seconds[name] / ran[name] if ran[name] else spent / number for name in left}
        work = sum(each[name] * count for name, count in left.items())
        return (time.monotonic() - self._started) * work / spent


class _Drawing:
    """Something that is drawn in parts after the tasks.

    done, count : parts that are drawn, and all; 0 until it starts
    expected : time that it may take [s]
    """

    def __init__(self, expected: float) -> None:
        self.done = self.count = 0
        self._expected, self._began, self._ended = expected, 0.0, 0.0

    @property
    def is_under_way(self) -> bool:
        return self._began > 0.0 and self.done < self.count

    @property
    def lasted(self) -> float:
        """Time since it began, or that it took [s]."""
        return (self._ended or time.monotonic()) - self._began if self._began else 0.0

    @property
    def left(self) -> float:
        """Time left [s]: by the parts drawn, before by what is expected."""
        if self._ended:
            return 0.0
        if not self.done:
            return max(self._expected - self.lasted, 0.0)
        return self.lasted * (self.count - self.done) / self.done

    def note(self, done: int, count: int) -> None:
        self._began = self._began or time.monotonic()
        self.done, self.count = done, count
        if done == count:
            self._ended = time.monotonic()


def _clock(seconds: float) -> str:
    """A time as people say it."""
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5970 else f"{seconds / 3600:.1f} h"


def _counted(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{number} {name}" for name, number in counts.items() if number) or "nothing to do"
