"""How many threads a task may use: the cores that no other task can."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

__all__ = ["free_threads", "in_free_threads", "with_threads"]

T = TypeVar("T")
Item = TypeVar("Item")

_THREADS: ContextVar[int] = ContextVar("threads", default=1)


def free_threads() -> int:
    """Threads that the task of this context may use."""
    return _THREADS.get()


def in_free_threads(function: Callable[[Item], T], items: Iterable[Item]) -> list[T]:
    """The values of a function for some items, in their order, in as many threads as this context may use."""
    if free_threads() == 1:
        return [function(item) for item in items]
    with ThreadPoolExecutor(free_threads()) as pool:
        return list(pool.map(function, items))


@contextmanager
def with_threads(count: int) -> Iterator[None]:
    """Let the task within use so many threads."""
    token = _THREADS.set(count)
    try:
        yield
    finally:
        _THREADS.reset(token)
