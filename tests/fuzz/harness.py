"""Reads changed files with one reader, and notes everything that is not a result or a message with place and remedy."""

from __future__ import annotations

import math
import random
import re
import resource
import signal
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dicflow.errors import DicflowError
from tests.fuzz.mutations import mutated

__all__ = ["Finding", "Target", "findings"]

MOST_SECONDS = 2.0
"""Of processor time for one input."""
MOST_BYTES = 500_000_000
LARGEST_NUMBER = 1e9


_CONTROL = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f]")


class Target(NamedTuple):
    """One reader of files.

    name : of the target
    file : name of the file that it reads
    seeds : contents of valid files
    read : reads the file; returns the numbers that must be sensible, in any nesting
    pack : makes the file of a changed content
    mark : what messages may name in place of the file
    """

    name: str
    file: str
    seeds: Sequence[bytes]
    read: Callable[[Path], Any]
    pack: Callable[[bytes, random.Random], bytes] = lambda data, chance: data
    mark: str = ""


class Finding(NamedTuple):
    """An input that was handled wrongly. number : from 0, repeats it"""

    target: str
    number: int
    problem: str
    data: bytes


class _TooSlow(BaseException):
    """Not an Exception, so that no reader catches it."""


def findings(target: Target, count: int, folder: Path, first: int = 0) -> Iterator[Finding]:
    """The inputs, among those of the given numbers, that are handled wrongly."""
    before = _peak_bytes()
    for number in range(first, first + count):
        chance = random.Random(f"{target.name} {number}")
        data = target.pack(mutated(chance.choice(target.seeds), chance), chance)
        path = folder / target.file
        path.write_bytes(data)
        problem = _problem(target, path)
        if not problem and _peak_bytes() - before > MOST_BYTES:
            problem, before = f"took {(_peak_bytes() - before) / 1e6:.0f} MB", _peak_bytes()
        if problem:
            yield Finding(target.name, number, problem, data)


def _problem(target: Target, path: Path) -> str:
    try:
        found = _within_time(lambda: target.read(path))
    except DicflowError as error:
        return _lack(error, (str(path), target.mark or str(path)))
    except _TooSlow:
        return f"took more than {MOST_SECONDS:g} s"
    except Exception:
        return traceback.format_exc(limit=-4)
    largest = max(map(abs, _numbers(found)), default=0.0)
    return "" if largest <= LARGEST_NUMBER else f"accepted the number {largest:g}"


def _within_time(read: Callable[[], Any]) -> Any:
    """Raise :class:`_TooSlow` after the limit of processor time; other work on the machine does not count."""

    def stop(*_: object) -> None:
        raise _TooSlow

    kept = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, MOST_SECONDS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return read()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, kept)


def _lack(error: DicflowError, places: tuple[str, ...]) -> str:
    """What a message lacks: the file's name, a problem or a remedy; or what it must not hold."""
    text = str(error)
    if _CONTROL.search(text):
        return f"a message with control characters: {text!r:.300}"
    if len(error.args) == 3:
        where, problem, remedy = error.args
        good = _names(where, places) and problem.strip() and remedy.strip()
    else:
        good = all(_names(line, places) and "; " in line for line in text.split("\n"))
    return "" if good else f"a message without file or remedy: {text!r:.300}"


def _names(text: str, places: tuple[str, ...]) -> bool:
    return any(place in text for place in places)


def _numbers(value: Any) -> Iterator[float]:
    """All known numbers in a result."""
    if isinstance(value, np.ndarray):
        known = value[~np.isnan(value)]
        yield from map(float, (known.min(), known.max()) if known.size else ())
    elif isinstance(value, dict):
        yield from _numbers(list(value.values()))
    elif isinstance(value, list | tuple):
        for one in value:
            yield from _numbers(one)
    elif isinstance(value, int | float) and not math.isnan(value):
        yield float(value)


def _peak_bytes() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
