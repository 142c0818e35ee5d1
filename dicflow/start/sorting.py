"""Photographs of two cameras in one folder: copies left out, and series parted by camera."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Sequence
from itertools import pairwise
from pathlib import Path, PurePosixPath

from dicflow.start.layouts import Series
from dicflow.start.words import words

__all__ = ["CameraOf", "TakenAt", "copied_from", "copies_in", "parted_by_counter"]

CameraOf = Callable[[PurePosixPath], str]
"""Make and model of the camera of a photograph; empty if its file does not say it."""
TakenAt = Callable[[PurePosixPath], float | None]
"""When a photograph was taken [s]; None if its file does not say it."""

_COPY = re.compile(
    r"(?P<name>.+?)(?: ?\(\d+\)| - (?:copy|kopie|copia|copie)(?: ?\(\d+\))?|[ _](?:copy|kopie)(?: ?\d+)?)",
    re.IGNORECASE,
)
"""Names that Windows, macOS and browsers give to a file whose name is taken already."""
_MIN_PHOTOGRAPHS = 3
_FAR = 20
"""A jump of the counter, over the largest other one, that parts two cameras where no times are known."""
_ALIKE = 0.5
"""Least ratio of the numbers of photographs of two cameras."""


def copied_from(path: PurePosixPath, others: Collection[PurePosixPath]) -> PurePosixPath | None:
    """The photograph whose name a copy repeats; None if the name is no copy's, or if there is no such photograph.

    >>> copied_from(PurePosixPath("a/IMG_1 (1).jpg"), {PurePosixPath("a/IMG_1.jpg")})
    PurePosixPath('a/IMG_1.jpg')
    """
    found = _COPY.fullmatch(path.stem)
    original = path.with_name(found["name"] + path.suffix) if found else path
    return original if original != path and original in others else None


def copies_in(
    folder: Path, paths: Collection[PurePosixPath], camera_of: CameraOf, taken: TakenAt
) -> list[PurePosixPath]:
    """Photographs that are there twice: with the name of a copy, and the same bytes, or the same camera and moment."""
    pairs = ((path, original) for path in paths if (original := copied_from(path, set(paths))) is not None)
    return [path for path, original in pairs if _are_one(folder, path, original, camera_of, taken)]


def _are_one(folder: Path, path: PurePosixPath, other: PurePosixPath, camera_of: CameraOf, taken: TakenAt) -> bool:
    if camera_of(path) and taken(path) is not None:
        return (camera_of(path), taken(path)) == (camera_of(other), taken(other))
    files = folder / path, folder / other
    return files[0].stat().st_size == files[1].stat().st_size and files[0].read_bytes() == files[1].read_bytes()


def parted_by_counter(one: Series, taken: TakenAt) -> list[Series]:
    """A series apart at the largest jump of its counter, if two cameras of one model have taken it.

    So it is where the photographs before and after the jump were taken alternately. Where times are unknown, it may be
    so after a jump that is far larger than any other: the parts then carry no name of a camera, so that somebody is
    asked.
    """
    numbers = _counter(one.files)
    if numbers is None or len(numbers) < 2 * _MIN_PHOTOGRAPHS:
        return [one]
    jumps = [later - before for before, later in pairwise(numbers)]
    at = jumps.index(max(jumps)) + 1
    parts = one.files[:at], one.files[at:]
    times = [taken(path) for path in one.files]
    known = [time for time in times if time is not None]
    if len(known) == len(times):
        names = [f"{one.camera} from {part[0].stem}" for part in parts]
        is_parted = _alternate(known[:at], known[at:])
    else:
        names = ["", ""]
        is_parted = _are_alike(parts) and max(jumps) > _FAR * max(
            (j for k, j in enumerate(jumps, 1) if k != at), default=1
        )
    return (
        [one._replace(files=part, camera=name) for part, name in zip(parts, names, strict=True)] if is_parted else [one]
    )


def _counter(files: Sequence[PurePosixPath]) -> list[int] | None:
    """The number that counts the photographs of a series; None if no number, or more than one, differs."""
    rows = [words(path.stem) for path in files]
    if len({len(row) for row in rows}) != 1:
        return None
    columns = [column for column in zip(*rows, strict=True) if len(set(column)) > 1]
    is_counter = len(columns) == 1 and all(word.isdecimal() for word in columns[0])
    return [int(word) for word in columns[0]] if is_counter else None


def _alternate(times: Sequence[float], others: Sequence[float]) -> bool:
    """Whether each of two series began before the other ended."""
    return min(times) < max(others) and min(others) < max(times)


def _are_alike(parts: Iterable[Sequence[PurePosixPath]]) -> bool:
    counts = sorted(map(len, parts))
    return counts[0] >= _MIN_PHOTOGRAPHS and counts[0] >= _ALIKE * counts[-1]
