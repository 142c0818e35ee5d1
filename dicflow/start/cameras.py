"""Which two series the two cameras took, by the words in their names."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from enum import IntEnum
from itertools import combinations
from typing import NamedTuple

from dicflow.io.images import natural_key
from dicflow.start.layouts import COUNTER, Name, Series, are_numbers
from dicflow.start.words import DEVICES, ORDINALS, SIDES

__all__ = ["Evidence", "Pair", "pairs_of"]

_MODELS = frozenset({
    "pro", "max", "mini", "plus", "ultra", "lite", "black", "edge", "note", "se", "hd", "mark", "ii", "iii",
})  # fmt: skip
"""Words that follow the name of a device."""
_MIN_LONG = 4


class Evidence(IntEnum):
    """What says that two series are of two cameras; the greater the better."""

    NOTHING = 0
    NUMBER = 1
    """A number or letter that stands alone or beside any word: 1 and 2, A and B."""
    DEVICE = 2
    """Names or numbers of devices: cam0 and cam1, iPhone 12 and Pixel 7."""
    SIDE = 3
    """Words for left and right."""
    USER = 4
    """The user named them."""


class Pair(NamedTuple):
    """The series of a left and of a right camera.

    labels : words that name the cameras
    context : the word beside these; empty if they stand alone
    is_exact : whether the names are alike but for these words; else the names of the files differ further
    """

    left: Series
    right: Series
    evidence: Evidence
    labels: tuple[str, str] = ("", "")
    context: str = ""
    is_exact: bool = True

    @property
    def rank(self) -> tuple[Evidence, bool]:
        """Sorts pairs by how sure they are."""
        return self.evidence, self.is_exact


class _Reading(NamedTuple):
    """A name with the words of its camera taken out; two series with equal keys and different labels may be a pair."""

    key: tuple[object, ...]
    evidence: Evidence
    label: str
    is_right: bool = False
    context: str = ""


def pairs_of(series: Sequence[Series]) -> list[Pair]:
    """Series that two cameras may have taken of one subject, the surest first.

    A series in a sure pair is in no pair that is less sure.
    """
    found = [pair for read in _by_key(series).values() for pair in _with_one_key(read)]
    found.sort(key=lambda pair: pair.rank, reverse=True)
    best: dict[Series, tuple[Evidence, bool]] = {}
    chosen: dict[tuple[Series, Series], Pair] = {}
    for pair in found:
        if all(best.setdefault(one, pair.rank) == pair.rank for one in (pair.left, pair.right)):
            chosen.setdefault((pair.left, pair.right), pair)
    return list(chosen.values())


def _by_key(series: Sequence[Series]) -> dict[tuple[object, ...], list[tuple[Series, _Reading]]]:
    by_key: dict[tuple[object, ...], list[tuple[Series, _Reading]]] = defaultdict(list)
    for one in series:
        for reading in dict.fromkeys([*_readings(one.name), *_makes(one)]):
            by_key[reading.key].append((one, reading))
    return by_key


def _with_one_key(read: Sequence[tuple[Series, _Reading]]) -> Iterator[Pair]:
    """The pairs among series whose names are alike but for the camera."""
    for (one, a), (other, b) in combinations(read, 2):
        if a.label != b.label and (a.evidence > Evidence.NUMBER or are_numbers({a.label, b.label})):
            if (a.is_right, natural_key(a.label)) > (b.is_right, natural_key(b.label)):
                one, a, other, b = other, b, one, a
            yield Pair(one, other, a.evidence, (a.label, b.label), a.context, bool(a.key[1]))


def _readings(name: Name) -> Iterator[_Reading]:
    """Every way to read the camera in a name."""
    yield from _sides(name)
    yield from _devices(name)
    yield from _numbers(name)


def _makes(one: Series) -> Iterator[_Reading]:
    """The make and model of the camera, beside the same folders and words, the same folders, or any."""
    if one.camera:
        for key in ((True, one.name), (False, one.name[:-1]), (False,)):
            yield _Reading(("make", *key), Evidence.DEVICE, one.camera)


def _sides(name: Name) -> Iterator[_Reading]:
    present = {word for part in name for word in part}
    for table, pair in enumerate(SIDES):
        found = present & set(pair)
        if len(found) == 1:
            label = found.pop()
            side = pair.index(label)
            alike = {label, *(other[side] for other in SIDES if len(other[side]) >= _MIN_LONG)}
            places = [[k for k, word in enumerate(part) if word in alike or k in _device_places(part)] for part in name]
            for key in _keys(name, places):
                yield _Reading((f"side {table}", *key), Evidence.SIDE, label, side == 1)


def _devices(name: Name) -> Iterator[_Reading]:
    """Names of devices with the model beside them."""
    places = [_device_places(part) for part in name]
    label = " ".join(part[k] for part, at in zip(name, places, strict=True) for k in at)
    if label:
        for key in _keys(name, places):
            yield _Reading(("device", *key), Evidence.DEVICE, label)


def _device_places(part: Sequence[str]) -> list[int]:
    """Places of the devices in a part of a name, each with its number, letter or model, and with an ordinal before."""
    places: list[int] = []
    for k, word in enumerate(part):
        follows = bool(places) and places[-1] == k - 1
        ordinal_before = word in ORDINALS and part[k + 1 : k + 2] and part[k + 1] in DEVICES
        if word in DEVICES or ordinal_before or (follows and (_is_index(word) or word in _MODELS | ORDINALS)):
            places.append(k)
    return places


def _numbers(name: Name) -> Iterator[_Reading]:
    """Each number or letter that may be a camera's; the same one elsewhere in the name goes with it."""
    indices = {word for part in name for word in part if _is_index(word)}
    for label in sorted(indices):
        places = [[k for k, word in enumerate(part) if word == label] for part in name]
        context = next(part[k - 1] if k else "" for part, at in zip(name, places, strict=True) for k in at)
        for key in _keys(name, places):
            yield _Reading(("number", *key), Evidence.NUMBER, label, context="" if context == COUNTER else context)


def _is_index(word: str) -> bool:
    return word.isdecimal() or (len(word) == 1 and word != COUNTER)


def _keys(name: Name, places: Sequence[Sequence[int]]) -> Iterator[tuple[bool, Name]]:
    """The name without the words at some places, as a whole, and without its file if a folder names the camera."""
    without = [tuple(word for k, word in enumerate(part) if k not in at) for part, at in zip(name, places, strict=True)]
    folders = tuple(part for part in without[:-1] if part)
    yield True, (*folders, without[-1])
    if any(places[:-1]):
        yield False, folders
