"""Patterns that find the photographs of a series and no others."""

from __future__ import annotations

import glob
from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import PurePosixPath

from dicflow.io.images import natural_key
from dicflow.io.images.search import fits
from dicflow.start.layouts import counted_words

__all__ = ["common_start", "listed", "named_briefly", "patterns_of"]

_MAX_LISTED = 3
_DIGITS = "0123456789"


def patterns_of(files: Sequence[PurePosixPath], photographs: Iterable[PurePosixPath]) -> list[str]:
    """Patterns that find these files of one folder, in their order, and no other photograph.

    files : in the order of the steps
    photographs : all that the folder holds
    """
    siblings = [path.name for path in photographs if path.parent == files[0].parent]
    names = [path.name for path in files]
    found = _pattern(names, siblings)
    if found is None:
        parts = [list(part) for _, part in groupby(names, key=lambda name: counted_words(PurePosixPath(name).stem))]
        found_parts = [_pattern(part, siblings) for part in parts]
        patterns = [one for one in found_parts if one] if all(found_parts) else [glob.escape(name) for name in names]
    else:
        patterns = [found]
    folder = files[0].parent.as_posix()
    return patterns if folder == "." else [f"{folder}/{pattern}" for pattern in patterns]


def named_briefly(files: Sequence[PurePosixPath], photographs: Sequence[PurePosixPath]) -> list[str]:
    """The folder of these files if it holds no other photograph, else patterns."""
    folder = files[0].parent
    below = [path for path in photographs if folder in path.parents]
    return [folder.as_posix()] if set(below) == set(files) else patterns_of(files, photographs)


def listed(patterns: Sequence[str]) -> str:
    """Patterns in a sentence; of many the first and the last."""
    return ", ".join(patterns) if len(patterns) <= _MAX_LISTED else f"{patterns[0]} … {patterns[-1]}"


def _pattern(names: Sequence[str], siblings: Sequence[str]) -> str | None:
    """The first of the usual patterns that matches these names alone and sorts them in their order."""
    if list(names) != sorted(names, key=natural_key):
        return None
    for pattern in _usual(names):
        if {one for one in siblings if fits(one, pattern)} == set(names):
            return pattern
    return None


def _usual(names: Sequence[str]) -> list[str]:
    """Patterns by what names have in common at their beginning and end, the simplest first."""
    if len(names) == 1:
        return [glob.escape(names[0])]
    ends = {PurePosixPath(name).suffix.lower() for name in names}
    ending = glob.escape(PurePosixPath(names[0]).suffix) if len(ends) == 1 else ""
    before, after = glob.escape(common_start(names)), glob.escape(common_start([n[::-1] for n in names])[::-1])
    short_before, short_after = before.rstrip(_DIGITS), after.lstrip(_DIGITS)
    return [
        f"*{ending}",
        f"{short_before}*{ending}",
        f"*{short_after}",
        f"{short_before}*{short_after}",
        f"{before}*{after}",
    ]


def common_start(names: Sequence[str]) -> str:
    """What all names begin with."""
    low, high = min(names), max(names)
    differ = (k for k, (one, other) in enumerate(zip(low, high, strict=False)) if one != other)
    return low[: next(differ, len(low))]
