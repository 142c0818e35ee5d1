"""Rows of a log that belong to the steps: by names, by order, or by the clocks."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from dicflow.errors import StageError

if TYPE_CHECKING:
    import numpy as np

    from dicflow.io.logs.log import Log

__all__ = ["JoinedRows", "StepClock", "joined_by_name", "joined_by_order", "joined_by_time"]

_DAY_S = 86_400.0
_NUMBER = re.compile(r"\d+")


class StepClock(NamedTuple):
    """Times of the steps.

    seconds : (step,), as the clock shows them; NaN where unknown
    is_date : whether they count from 1970
    utc : (step,) — the same in UTC; None unless all steps say how far their clock is from it
    """

    seconds: np.ndarray
    is_date: bool
    utc: np.ndarray | None = None


class JoinedRows(NamedTuple):
    """Where the steps lie in a log.

    rows : (step,) — row of each step, −1 for none; None if they are joined by time
    at : (step,) — time of each step [s], as the log's counts in ``seconds``; NaN where unknown
    seconds : (row,) — times of the log's rows; None if it has none
    offset, u_offset : what the log's clock shows more than that of the steps, and its uncertainty; None if not used
    """

    rows: np.ndarray | None
    at: np.ndarray
    seconds: np.ndarray | None
    offset: float | None = None
    u_offset: float = 0.0


def joined_by_order(log: Log, steps: Sequence[str]) -> JoinedRows:
    """Row k for step k. Raises StageError unless there are as many."""
    import numpy as np

    if len(log.numbers) != len(steps):
        raise StageError(
            f"{log.where}: has {len(log.numbers)} rows for {len(steps)} steps; write one row per step, or join by name "
            "or time"
        )
    return _of_rows(log, np.arange(len(steps)))


def joined_by_name(log: Log, steps: Sequence[str]) -> JoinedRows:
    """The row that names each step, by its whole name or by the last number in it.

    Raises StageError if two rows name one step, or if none names any.
    """
    import numpy as np

    if log.steps is None:
        raise StageError(f"{log.where}: has no column with names of steps; name it with columns: {{step: …}}")
    rows = _rows_by(log, [name.rpartition(".")[0] or name for name in log.steps], list(steps))
    if (rows < 0).all():
        rows = _rows_by(log, [_number(name) for name in log.steps], [_number(name) for name in steps])
    if (rows < 0).all():
        raise StageError(
            f"{log.where}: no row has the name of a step; it has {log.steps[0]}, the steps are {steps[0]} … {steps[-1]}"
        )
    return _of_rows(log, np.array(rows))


def joined_by_time(log: Log, clock: StepClock | None, offset: float | None, moves: np.ndarray | None) -> JoinedRows:
    """The steps' times by the log's clock.

    offset : of the log's clock; None for clocks that show the same date and time
    moves : change of the picture from step to step, in the order of their times (step − 1,), to find the offset by;
        None if it is given
    Raises StageError if the clocks cannot be joined.
    """
    if log.clock is None:
        raise StageError(f"{log.where}: has no column with times; name it with columns: {{time: …}}, or join by order")
    if clock is None:
        raise StageError("the photographs have no times, so that no log can be joined by time; join by name or order")
    seconds, at = _on_common_scale(log, clock)
    u = 0.0
    if moves is not None:
        offset, u = _found_offset(log, at, moves, seconds)
    elif offset is None and not (log.clock.has_date and clock.is_date):
        raise StageError(
            f"{log.where}: its clock and that of the photographs do not both show a date; give offset, the seconds "
            "that the log shows more than the photographs at one moment, or offset: auto"
        )
    joined = JoinedRows(None, at + (offset or 0.0), seconds, offset or 0.0, u)
    _check_overlap(log, joined)
    return joined


def _of_rows(log: Log, rows: np.ndarray) -> JoinedRows:
    """Rows with the log's own times, counted from its first one."""
    import numpy as np

    at = np.full(len(rows), np.nan)
    if log.clock is None:
        return JoinedRows(rows, at, None)
    at[rows >= 0] = log.clock.seconds[rows[rows >= 0]]
    return JoinedRows(rows, at, log.clock.seconds)


def _rows_by(log: Log, names: Sequence[str], steps: Sequence[str]) -> np.ndarray:
    """Row of each step (step,), −1 for none."""
    import numpy as np

    places: dict[str, int] = {}
    wanted = set(steps)
    for row, name in enumerate(names):
        if name and name in wanted:
            if name in places:
                line = log.numbers[row]
                raise StageError(f"{log.where}:{line}: names step '{name}' again; leave one row for each step")
            places[name] = row
    return np.array([places.get(step, -1) for step in steps])


def _number(name: str) -> str:
    """The last number in a name, without zeros before it; empty without a number."""
    found = _NUMBER.findall(name)
    return str(int(found[-1])) if found else ""


def _on_common_scale(log: Log, clock: StepClock) -> tuple[np.ndarray, np.ndarray]:
    """Times of the log and of the steps: of the date if both show it, else each since its own start.

    Dates are compared in UTC where both clocks say how far they are from it, else as they are shown, since clocks of
    one place show the same. A log with times of day alone begins on the day of the first step.
    """
    import numpy as np

    assert log.clock is not None
    seconds, at = log.clock.seconds, clock.seconds
    if log.clock.has_date and clock.is_date:
        both = log.clock.utc, clock.utc
        return (seconds, at) if both[0] is None or both[1] is None else (both[0], both[1])
    first, start = seconds[np.isfinite(seconds)][:1], at[np.isfinite(at)][:1]
    if clock.is_date and log.clock.of_day:
        return seconds + _DAY_S * np.floor(start / _DAY_S), at
    counts_from = first if log.clock.has_date or log.clock.of_day else 0.0
    return seconds - counts_from, at - (start if clock.is_date else 0.0)


def _found_offset(log: Log, at: np.ndarray, moves: np.ndarray, seconds: np.ndarray) -> tuple[float, float]:
    """The offset by the motion, and its uncertainty."""
    import numpy as np

    from dicflow.core.channels.offset import find_offset

    name, values = _moving(log)
    if not np.isfinite(at).all():
        raise StageError("a photograph has no time, so that the offset cannot be found; give offset in seconds")
    known = np.isfinite(values) & np.isfinite(seconds)
    try:
        found = find_offset(np.sort(at), moves, seconds[known], values[known])
    except ValueError as error:
        raise StageError(f"{log.where}: the offset cannot be found: {error}; give offset in seconds") from error
    if not found.is_clear:
        other = "" if np.isnan(found.other) else f" and {found.other:.4g} s"
        raise StageError(
            f"{log.where}: {name} and the pictures do not move alike enough to join their clocks: the best offset, "
            f"{found.seconds:.4g} s{other}, gives a correlation of {found.correlation:.2f}; give offset in seconds"
        )
    return found.seconds, found.u


def _moving(log: Log) -> tuple[str, np.ndarray]:
    """Name and values of the channel that moves with the specimen: a length, else a force, else any."""
    for unit in ("mm", "N"):
        for name, column in log.columns.items():
            if column.unit == unit:
                return name, column.values
    raise StageError(
        f"{log.where}: has neither a length nor a force by which to find the offset; give offset in seconds"
    )


def _check_overlap(log: Log, joined: JoinedRows) -> None:
    """Raise StageError if no step lies within the log."""
    import numpy as np

    assert joined.seconds is not None
    first, last = float(np.nanmin(joined.seconds)), float(np.nanmax(joined.seconds))
    start, end = float(np.nanmin(joined.at)), float(np.nanmax(joined.at))
    if end < first or start > last:
        apart = f"{first - end:.5g} s after the last" if end < first else f"{start - last:.5g} s before the first"
        verb = "begins" if end < first else "ends"
        raise StageError(
            f"{log.where}: {verb} {apart} photograph by these clocks; correct offset, now {joined.offset:.5g} s "
            "(another time zone is 3600 s per hour), or use offset: auto"
        )
