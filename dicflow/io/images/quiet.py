"""Silence while libraries decode: those in C print complaints about a file past Python, to standard error."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Lock

__all__ = ["quiet"]

_STANDARD_ERROR = 2


class _Silence:
    """How many threads decode, and where standard error went before the first of them."""

    lock = Lock()
    threads = 0
    before: int | None = None


@contextmanager
def quiet() -> Iterator[None]:
    """Let nothing that this process writes to standard error through, until all threads have left."""
    with _Silence.lock:
        _Silence.threads += 1
        if _Silence.threads == 1:
            with suppress(OSError):  # without a standard error nothing is printed
                _Silence.before = os.dup(_STANDARD_ERROR)
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, _STANDARD_ERROR)
                os.close(nowhere)
    try:
        yield
    finally:
        with _Silence.lock:
            _Silence.threads -= 1
            if _Silence.threads == 0 and _Silence.before is not None:
                os.dup2(_Silence.before, _STANDARD_ERROR)
                os.close(_Silence.before)
                _Silence.before = None
