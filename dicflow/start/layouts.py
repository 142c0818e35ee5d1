"""Series of photographs in a folder, by their names alone.

Paths are relative to the folder. A **series** is what one camera took of one subject: the photographs in one folder
whose names have the same words; their numbers may differ.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import PurePosixPath
from typing import NamedTuple

from dicflow.io.images import RAW_SUFFIXES, natural_key
from dicflow.start.words import DEVICES, FIRST_WORDS, REGION_WORDS, SIDES, words

__all__ = ["COUNTER", "Name", "Series", "are_numbers", "counted_words", "is_serial", "series_of", "step_folders"]

Name = tuple[tuple[str, ...], ...]
"""Words of each folder of a path, and of its file; ``#`` stands for what counts the photographs."""

COUNTER = "#"
_MAX_CAMERAS = 4
_MIN_STEPS = 2
_MIN_FOLDERS = 3
_MIN_COMMON = 0.75
_SERIAL_DIGITS = 5
_DATE = re.compile(r"(19|20)\d{6}")
_OTHER_SIDE: Mapping[str, frozenset[str]] = {
    word: frozenset(other for pair in SIDES if word in pair for other in pair if other != word)
    for word in (word for pair in SIDES for word in pair)
}


class Series(NamedTuple):
    """Photographs of one camera and one subject.

    files : relative paths in the order of the steps
    name : words of the folders and files
    camera : make and model of the camera; empty if unknown
    """

    files: tuple[PurePosixPath, ...]
    name: Name
    camera: str = ""

    @property
    def folder(self) -> PurePosixPath:
        """The folder that holds the photographs."""
        return self.files[0].parent

    @property
    def words(self) -> frozenset[str]:
        """All words of its name."""
        return frozenset(word for part in self.name for word in part)


def series_of(paths: Iterable[PurePosixPath], camera_of: Callable[[PurePosixPath], str] | None = None) -> list[Series]:
    """The series among photographs, in natural order of their paths; their own order does not matter.

    camera_of : label of the camera that took a photograph; photographs with different labels are in different series

    A photograph whose name has words of its own joins the series beside it only if it is the first of the test, or if
    all photographs in its folder are named so; else it belongs to no series.
    """
    groups: dict[tuple[PurePosixPath, str], list[PurePosixPath]] = defaultdict(list)
    for path in sorted(set(paths), key=_natural):
        groups[path.parent, camera_of(path) if camera_of else ""].append(path)
    return [
        one._replace(camera=camera) for (folder, camera), files in groups.items() for one in _in_folder(folder, files)
    ]


def _natural(path: PurePosixPath) -> tuple[object, ...]:
    return (*(natural_key(part) for part in path.parts), path.parts)


def _in_folder(folder: PurePosixPath, files: Sequence[PurePosixPath]) -> list[Series]:
    """The series in one folder."""
    groups: dict[tuple[str, ...], list[PurePosixPath]] = defaultdict(list)
    for path in _without_copies(files):
        groups[counted_words(path.stem)].append(path)
    split = {name: part for words_, group in groups.items() for name, part in _by_number(words_, group).items()}
    above = tuple(words(part) for part in folder.parts)
    return [Series(tuple(part), (*above, name)) for name, part in _joined(split).items()]


def _without_copies(files: Sequence[PurePosixPath]) -> list[PurePosixPath]:
    """Of photographs that differ in their suffix alone, the one in the format that loses least."""
    best: dict[str, PurePosixPath] = {}
    for path in files:
        other = best.setdefault(path.stem, path)
        if _loss(path) < _loss(other):
            best[path.stem] = path
    return list(best.values())


def _loss(path: PurePosixPath) -> int:
    """Place of a format among all: JPEG loses most of those that need no decoder of their own; a video comes last."""
    starts = (".tif", ".png", ".bmp", ".jp", *RAW_SUFFIXES)
    return next((k for k, start in enumerate(starts) if path.suffix.lower().startswith(start)), len(starts))


def counted_words(stem: str) -> tuple[str, ...]:
    """Words of a file's name with one ``#`` for each run of numbers.

    >>> counted_words("test_0012_L")
    ('test', '#', 'l')
    """
    return _counted(words(stem))


def _counted(stem: Sequence[str]) -> tuple[str, ...]:
    marked = [COUNTER if word.isdecimal() else word for word in stem]
    return tuple(word for k, word in enumerate(marked) if k == 0 or word != COUNTER or marked[k - 1] != COUNTER)


def _by_number(name: tuple[str, ...], files: Sequence[PurePosixPath]) -> dict[tuple[str, ...], list[PurePosixPath]]:
    """The files apart by the number in their names that tells the camera, if there is one."""
    place = _camera_place([words(path.stem) for path in files])
    if place is None:
        return {name: list(files)}
    parts: dict[tuple[str, ...], list[PurePosixPath]] = defaultdict(list)
    for path in files:
        parts[_with_number(words(path.stem), place)].append(path)
    return parts


def _with_number(stem: Sequence[str], place: int) -> tuple[str, ...]:
    """The pattern of a name in which the word at one place is kept although it is a number."""
    return (*_counted(stem[:place]), stem[place], *_counted(stem[place + 1 :]))


def _camera_place(rows: Sequence[tuple[str, ...]]) -> int | None:
    """The place in the words of files, all with the same words, whose number names the camera; None without one.

    For each of its values, the other numbers must be nearly the same. A number beside a device's name counts before one
    that stands alone, the last before the first, and these before a number beside any other word.
    """
    if len({len(row) for row in rows}) > 1:
        return None
    places = [k for k, word in enumerate(rows[0]) if word.isdecimal() and _splits(rows, k)]
    return max(places, key=lambda k: (*_weight(rows[0], k), k), default=None)


def _splits(rows: Sequence[tuple[str, ...]], place: int) -> bool:
    """Whether the number at a place has few values that share the other numbers."""
    others: dict[str, set[tuple[str, ...]]] = defaultdict(set)
    for row in rows:
        others[row[place]].add((*row[:place], *row[place + 1 :]))
    if not 2 <= len(others) <= _MAX_CAMERAS or not (_weight(rows[0], place)[0] or are_numbers(set(others))):
        return False
    common, all_ = set.intersection(*others.values()), set.union(*others.values())
    return len(common) >= _MIN_STEPS and len(common) >= _MIN_COMMON * len(all_)


def _weight(row: Sequence[str], place: int) -> tuple[bool, bool]:
    """Whether a device stands before or after a number, and whether the number stands alone."""
    before = row[place - 1] if place else ""
    after = row[place + 1] if place + 1 < len(row) else ""
    return bool({before, after} & DEVICES), not before or before.isdecimal()


def are_numbers(labels: Collection[str]) -> bool:
    """Whether labels are two that people number two cameras with: 0 and 1, 1 and 2, a and b, or serial numbers.

    >>> are_numbers({"1", "2"}), are_numbers({"1", "3"}), are_numbers({"a", "b"}), are_numbers({"21284923", "21284930"})
    (True, False, True, True)
    """
    return set(labels) in ({"0", "1"}, {"1", "2"}, {"a", "b"}) or (len(labels) == 2 and all(map(is_serial, labels)))


def is_serial(label: str) -> bool:
    """Whether a label is a number of many digits and no date."""
    return label.isdecimal() and len(label) >= _SERIAL_DIGITS and not _DATE.fullmatch(label)


def step_folders(series: Sequence[Series]) -> list[Series]:
    """Series of one photograph each, in folders that differ in a number alone, as if each step had a folder."""
    alike: dict[Name, list[Series]] = defaultdict(list)
    for one in series:
        if len(one.files) == 1:
            alike[tuple(_counted(part) for part in one.name)].append(one)
    return max((group for group in alike.values() if len(group) >= _MIN_FOLDERS), key=len, default=[])


def _joined(
    groups: Mapping[tuple[str, ...], list[PurePosixPath]],
) -> dict[tuple[str, ...], list[PurePosixPath]]:
    """Groups of a folder with single photographs joined to those of the same camera, as :func:`series_of` says."""
    cameras: dict[frozenset[str], list[tuple[str, ...]]] = defaultdict(list)
    for name in groups:
        if len(groups[name]) > 1 or not REGION_WORDS & set(name):
            cameras[_sides(name, groups)].append(name)
    joined: dict[tuple[str, ...], list[PurePosixPath]] = {}
    for side, names in cameras.items():
        large = [name for name in names if len(groups[name]) > 1]
        single = [name for name in names if len(groups[name]) == 1]
        first = [name for name in single if FIRST_WORDS & set(name)]
        if not large:
            name = single[0] if len(single) == 1 else tuple(sorted(side))
            joined[name] = [groups[one][0] for one in (*first, *(one for one in single if one not in first))]
        elif len(large) == 1 and len(first) == 1:
            joined[large[0]] = [groups[first[0]][0], *groups[large[0]]]
        else:
            joined |= {name: groups[name] for name in large}
    return joined


def _sides(name: tuple[str, ...], names: Iterable[tuple[str, ...]]) -> frozenset[str]:
    """The words of a camera in a name: those whose counterpart stands in another name."""
    present = {word for other in names for word in other}
    return frozenset(word for word in name if _OTHER_SIDE.get(word, frozenset()) & present)
