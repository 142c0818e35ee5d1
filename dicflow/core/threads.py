"""Work shared among threads; what it gives does not depend on their number."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

__all__ = ["at_once", "over"]

T = TypeVar("T")
Item = TypeVar("Item")


def at_once(threads: int, *calls: Callable[[], Any]) -> list[Any]:
    """The values of calls, in their order. Raises what the first of them that fails raises."""
    return over(threads, _called, calls)


def over(threads: int, function: Callable[[Item], T], items: Iterable[Item]) -> list[T]:
    """The values of a function for some items, in their order, computed in so many threads."""
    items = list(items)
    if min(threads, len(items)) <= 1:
        return [function(item) for item in items]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, items))


def _called(call: Callable[[], Any]) -> Any:
    return call()
