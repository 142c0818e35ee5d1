"""Ways to pair the photographs of two cameras: by their names, by the times when they were taken, or in their order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import PurePosixPath
from typing import NamedTuple

from dicflow.errors import InputError
from dicflow.io.images import counter_offset, pair_names
from dicflow.start.choice import By
from dicflow.start.clocks import Ambiguous, Clocks, partners_by_time
from dicflow.start.layouts import Series
from dicflow.start.patterns import patterns_of

__all__ = ["WAYS", "Taken", "Way", "chosen_way", "possible_way", "usual_way", "ways_to_pair"]

WAYS: dict[By, str] = {
    "name": "by the numbers and words in their names",
    "taken": "by the time when they were taken",
    "order": "in their order",
}
"""What pairs photographs, in words."""

Taken = Callable[[PurePosixPath], float | None]
"""When a photograph was taken [s]; None if its file does not say it."""


class Way(NamedTuple):
    """A way to pair two series.

    pairs : files of each pair, in the order of the steps
    alone : files without a partner
    note : what a person should know of it; empty if nothing
    """

    by: By
    pairs: tuple[tuple[PurePosixPath, PurePosixPath], ...]
    alone: tuple[PurePosixPath, ...] = ()
    note: str = ""

    @property
    def is_listed(self) -> bool:
        """Whether the photographs must be listed in the order of the pairs, since their names do not tell these."""
        return self.by != "name" or bool(self.alone)

    @property
    def words(self) -> str:
        """What makes the pairs, and what a person should know of it."""
        return WAYS[self.by] + (f" ({self.note})" if self.note else "")

    def patterns(self, left: Series, right: Series, photographs: Sequence[PurePosixPath]) -> dict[str, list[str]]:
        """Left and right → patterns that find the photographs, in the order of the pairs where names make none.

        left, right : the whole series; photographs : all that the folder holds
        """
        sides = zip(*self.pairs, strict=True) if self.is_listed else (left.files, right.files)
        return {side: patterns_of(files, photographs) for side, files in zip(("left", "right"), sides, strict=True)}


def ways_to_pair(left: Series, right: Series, taken: Taken) -> list[Way]:
    """All ways that give pairs, the surest first; empty if none does."""
    return list(_ways(left, right, taken))


def chosen_way(left: Series, right: Series, taken: Taken, by: By | None) -> Way:
    """The way that a person asks for, else the surest one that needs nobody to confirm it.

    Raises InputError that says how to pair these photographs.
    """
    ways = ways_to_pair(left, right, taken)
    found = usual_way(left, right, ways) if by is None else next((way for way in ways if way.by == by), None)
    if found is None:
        raise InputError(_refusal(left, right, ways, by))
    return found


def usual_way(left: Series, right: Series, ways: Sequence[Way]) -> Way | None:
    """The surest of these ways that nobody has to confirm; None without one.

    Names that leave a photograph alone must be confirmed, and so must the order, unless the counters run alike.
    """
    return next((way for way in ways if _is_sure(way, left, right)), None)


def _is_sure(way: Way, left: Series, right: Series) -> bool:
    if way.by == "name":
        return not way.alone
    return way.by == "taken" or _counts_alike(left, right)


def possible_way(left: Series, right: Series, taken: Taken, by: By | None) -> By | None:
    """The way that a person asks for, if it pairs these series; else None."""
    return by if by in [way.by for way in ways_to_pair(left, right, taken)] else None


def _ways(left: Series, right: Series, taken: Taken) -> Iterator[Way]:
    if named := _by_name(left, right):
        yield named
    if timed := _by_time(left, right, taken):
        yield timed
    if len(left.files) == len(right.files):
        yield Way("order", tuple(zip(left.files, right.files, strict=True)), note=_order_note(left, right))


def _by_name(left: Series, right: Series) -> Way | None:
    sides = [{path.name: path for path in one.files} for one in (left, right)]
    try:
        found = pair_names(list(sides[0]), list(sides[1]), unpaired="skip")
    except InputError:
        return None
    if found.by == "order":
        return None
    return _with_alone("name", tuple((sides[0][a], sides[1][b]) for a, b in found.pairs), left, right)


def _with_alone(
    by: By, pairs: tuple[tuple[PurePosixPath, PurePosixPath], ...], left: Series, right: Series, note: str = ""
) -> Way:
    """A way with the files that have no partner, which its note names."""
    paired = {path for pair in pairs for path in pair}
    alone = tuple(path for path in (*left.files, *right.files) if path not in paired)
    notes = [note, f"without a partner, left out: {_named(alone)}" if alone else ""]
    return Way(by, pairs, alone, "; ".join(filter(None, notes)))


def _by_time(left: Series, right: Series, taken: Taken) -> Way | None:
    clocks = _clocks(left, right, taken)
    if clocks is None:
        return None
    pairs = tuple((left.files[i], right.files[j]) for i, j in clocks.pairs)
    ahead = clocks.ahead_s
    note = f"the right camera's clock is {_duration(abs(ahead))} {'ahead' if ahead > 0 else 'behind'}"
    return _with_alone("taken", pairs, left, right, note)


def _clocks(left: Series, right: Series, taken: Taken) -> Clocks | None:
    """Partners by time; None if a time is unknown, or if the times tell no partners."""
    times, others = ([taken(path) for path in one.files] for one in (left, right))
    try:
        return partners_by_time(_known(times), _known(others))
    except (Ambiguous, InputError):
        return None


def _known(times: Sequence[float | None]) -> list[float]:
    """The times. Raises InputError if one is unknown."""
    known = [time for time in times if time is not None]
    if len(known) < len(times):
        raise InputError("a photograph does not say when it was taken")
    return known


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    hours, minutes = divmod(round(seconds / 60.0), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"


def _order_note(left: Series, right: Series) -> str:
    if _counts_alike(left, right):
        return "their counters run alike"
    return "right only if no photograph is missing on either side"


def _counts_alike(left: Series, right: Series) -> bool:
    """Whether the counters in the names of two cameras run alike but never agree."""
    offset = counter_offset([path.name for path in left.files], [path.name for path in right.files])
    return offset is not None and abs(offset) >= len(left.files)


def _refusal(left: Series, right: Series, ways: Sequence[Way], by: By | None) -> str:
    counts = f"{len(left.files)} left and {len(right.files)} right photographs"
    first, last = (f"{left.files[k].name} with {right.files[k].name}" for k in (0, -1))
    named = next((way for way in ways if way.by == "name"), None)
    if named is not None and by is None:
        return (
            f"{counts}; without a partner: {_named(named.alone)}; add the missing ones or move these away, or "
            "--pair-by name leaves them out"
        )
    if any(way.by == "order" for way in ways) and by is None:
        return (
            f"{counts}: neither names nor times tell which belong together; --pair-by order pairs {first} … {last}, "
            "which is right only if no photograph is missing on either side"
        )
    problem = f"cannot be paired {WAYS[by]}" if by else "neither names nor times tell which belong together"
    return f"{counts}: {problem}; add the missing photographs, or move those without a partner away"


def _named(paths: Sequence[PurePosixPath], most: int = 3) -> str:
    names = ", ".join(path.name for path in paths[:most])
    return names + (f" and {len(paths) - most} more" if len(paths) > most else "")
