"""How many threads a task may use: the cores that no other task can."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

__all__ = ["free_threads", "with_threads"]

_THREADS: ContextVar[int] = ContextVar("threads", default=1)


def free_threads() -> int:
    """Threads that the task of this context may use."""
    return _THREADS.get()


@contextmanager
def with_threads(count: int) -> Iterator[None]:
    """Let the task within use so many threads."""
    token = _THREADS.set(count)
    try:
        yield
    finally:
        _THREADS.reset(token)
