"""The question about cameras that names and photographs leave open, with a command line for each answer."""

from __future__ import annotations

import glob
import shlex
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path, PurePosixPath

from dicflow.start.choice import Candidate, Choice, Undecided
from dicflow.start.layouts import Series
from dicflow.start.patterns import common_start, listed, named_briefly

__all__ = ["question"]

_MAX_WORDS = 10
"""Of a command line, above which one pattern per camera is tried instead."""


def question(
    folder: Path,
    undecided: Undecided,
    command: Sequence[str],
    photographs: Sequence[PurePosixPath],
    has_calibration: bool = False,
    is_settled: Callable[[Choice, Candidate], bool] = lambda choice, candidate: False,
) -> str:
    """What is believed and what else it could be; each with the command line that settles it.

    command : words of the command line so far
    photographs : all in the folder, as relative paths
    has_calibration : whether a file there holds the rig
    is_settled : whether patterns that the user may name select a candidate and no other
    """
    lines = [f"{folder}: {undecided.reason}; --left, --right and --boards, or --one-camera, settle it"]
    for k, candidate in enumerate(undecided.candidates):
        starts = "or" if k else "either" if undecided.otherwise else "most likely"
        lines.append(f"{starts} {_words(candidate, photographs, has_calibration)}:")
        options = [*_options(candidate, photographs)]
        briefs = _briefs(candidate, len(options), bool(undecided.otherwise))
        brief = next((one for one in briefs if is_settled(one, candidate)), None)
        lines.append("  " + shlex.join([*command, *(_named_options(brief) if brief else options)]))
    return "\n".join([*lines, f"or {undecided.otherwise}"] if undecided.otherwise else lines)


def _words(candidate: Candidate, photographs: Sequence[PurePosixPath], has_calibration: bool) -> str:
    left = _named(candidate.left, photographs)
    if candidate.right is None:
        return f"one camera, {left}"
    cameras = f"two cameras, left {left} and right {_named(candidate.right, photographs)}"
    if candidate.boards is None:
        return cameras if has_calibration else f"{cameras}, once photographs of a board by both are in the folder"
    boards = (_named(one, photographs) for one in (candidate.boards.left, candidate.boards.right))
    return f"{cameras}, boards {' and '.join(boards)}"


def _named(series: Series, photographs: Sequence[PurePosixPath]) -> str:
    count = len(series.files)
    return f"{listed(named_briefly(series.files, photographs))} ({count} photograph{'s' if count > 1 else ''})"


def _briefs(candidate: Candidate, words: int, is_only: bool) -> Iterator[Choice]:
    """What may select a candidate in fewer words than those of its options. is_only : whether there is no other"""
    if candidate.right is None and is_only:
        yield Choice(one_camera=True)
    brief = _brief(candidate) if words > _MAX_WORDS else None
    if brief:
        yield brief


def _brief(candidate: Candidate) -> Choice | None:
    """One pattern per camera, of its specimen and its boards; None if their names have no common beginning."""
    boards = candidate.boards
    left = _beginning([candidate.left, *([boards.left] if boards else [])])
    right = _beginning([candidate.right, *([boards.right] if boards else [])]) if candidate.right else None
    if left is None or (candidate.right and right is None):
        return None
    return Choice((left,), (right,) if right else (), one_camera=candidate.right is None)


def _beginning(series: Sequence[Series]) -> str | None:
    files = [path for one in series for path in one.files]
    beginning = common_start([path.name for path in files]).rstrip("0123456789")
    if not beginning or len({path.parent for path in files}) > 1:
        return None
    return glob.escape((files[0].parent / beginning).as_posix()) + "*"


def _named_options(choice: Choice) -> list[str]:
    sides = [*(("--left", one) for one in choice.left), *(("--right", one) for one in choice.right)]
    return [*(word for pair in sides for word in pair), *["--one-camera"] * choice.one_camera]


def _options(candidate: Candidate, photographs: Sequence[PurePosixPath]) -> Iterator[str]:
    pairs = [(candidate.left, candidate.right), *([candidate.boards[:2]] if candidate.boards else [])]
    for one, other in pairs:
        for option, series in (("--left", one), ("--right", other)):
            yield from _option(option, series, photographs)
    if candidate.right is None:
        yield "--one-camera"
    for series in candidate.boards[:2] if candidate.boards else ():
        yield from _option("--boards", series, photographs)


def _option(option: str, series: Series | None, photographs: Sequence[PurePosixPath]) -> Iterator[str]:
    for pattern in named_briefly(series.files, photographs) if series else ():
        yield from (option, pattern)
