"""The question about cameras that names and photographs leave open, with a command line for each answer."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

from dicflow.start.choice import Candidate, Undecided
from dicflow.start.layouts import Series
from dicflow.start.patterns import listed, named_briefly

__all__ = ["question"]


def question(
    folder: Path,
    undecided: Undecided,
    command: Sequence[str],
    photographs: Sequence[PurePosixPath],
    has_calibration: bool = False,
) -> str:
    """What is believed and what else it could be; each with the command line that settles it.

    command : words of the command line so far
    photographs : all in the folder, as relative paths
    has_calibration : whether a file there holds the rig
    """
    lines = [f"{folder}: {undecided.reason}; --left, --right and --boards, or --one-camera, settle it"]
    for k, candidate in enumerate(undecided.candidates):
        lines.append(f"{'or' if k else 'most likely'} {_words(candidate, photographs, has_calibration)}:")
        lines.append("  " + shlex.join([*command, *_options(candidate, photographs)]))
    return "\n".join(lines)


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
