"""Silence while libraries decode: those in C print complaints about a file past Python, to standard error.

What they print can be read, since some libraries report damage in no other way.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from tempfile import TemporaryFile
from threading import Lock
from typing import BinaryIO

__all__ = ["quiet"]

_STANDARD_ERROR = 2
_MOST_BYTES = 10_000
"""Of what was written, as much is read."""


class _Silence:
    """How many threads decode, where standard error went before the first of them, and where it goes meanwhile."""

    lock = Lock()
    threads = 0
    before: int | None = None
    heard: BinaryIO | None = None


@contextmanager
def quiet() -> Iterator[Callable[[], str]]:
    """Let nothing that this process writes to standard error through, until all threads have left.

    Gives a function that returns what was written since.
    """
    with _Silence.lock:
        _Silence.threads += 1
        if _Silence.threads == 1:
            _begin()
        since = 0 if _Silence.heard is None else _Silence.heard.seek(0, os.SEEK_END)
    try:
        yield lambda: _heard(since)
    finally:
        with _Silence.lock:
            _Silence.threads -= 1
            if _Silence.threads == 0:
                _end()


def _begin() -> None:
    with suppress(OSError):  # without a standard error nothing is printed
        _Silence.before = os.dup(_STANDARD_ERROR)
        _Silence.heard = _Silence.heard or TemporaryFile(buffering=0)  # noqa: SIM115
        _Silence.heard.truncate(0)
        _Silence.heard.seek(0)
        os.dup2(_Silence.heard.fileno(), _STANDARD_ERROR)


def _end() -> None:
    if _Silence.before is not None:
        os.dup2(_Silence.before, _STANDARD_ERROR)
        os.close(_Silence.before)
        _Silence.before = None


def _heard(since: int) -> str:
    """What was written from a place on. The file and standard error share their place."""
    with _Silence.lock:
        if _Silence.heard is None:
            return ""
        end = _Silence.heard.seek(0, os.SEEK_END)
        _Silence.heard.seek(since)
        text = _Silence.heard.read(min(end - since, _MOST_BYTES))
        _Silence.heard.seek(end)
    return text.decode("utf-8", "replace")
