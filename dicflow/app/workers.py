"""Processes of their own for work that loads numerics."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from multiprocessing import get_context
from typing import Any

from dicflow.engine.kernel_cache import keep_kernels
from dicflow.engine.references import cache
from dicflow.engine.workers import hold_to_one_thread, ignore_interrupts, limit_threads
from dicflow.errors import WorkerError

__all__ = ["Worker", "named"]

_CACHE_BYTES = 16_000_000
"""Of products that are made again when they are read, such as photographs."""


def named(name: str, *arguments: Any) -> Any:
    """The value of ``module.function`` of this package, which only the process that calls it then loads."""
    module, _, function = name.partition(".")
    return getattr(import_module(f"{__package__}.{module}"), function)(*arguments)


class Worker:
    """One process, which starts with its first work.

    works : pieces of work after which it is renewed, with its memory; None for never
    """

    def __init__(self, works: int | None = None) -> None:
        self._works = works
        self._pool = self._made()

    def begin(self, name: str) -> None:
        """Start the process, and let it call ``module.function`` of this package, without waiting for it."""
        self._pool.submit(named, name)

    def do(self, call: Callable[..., Any], *arguments: Any) -> Any:
        """The value of a function of a module, called in the process. Raises WorkerError if that process dies."""
        pool = self._pool
        try:
            return pool.submit(call, *arguments).result()
        except BrokenProcessPool as error:
            if pool is self._pool:
                self._pool = self._made()
            raise WorkerError("the process that prepares this was killed; probably out of memory") from error

    def close(self) -> None:
        """End the process, when what it is at is done."""
        self._pool.shutdown(cancel_futures=True)

    def _made(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, get_context("spawn"), initializer=_ready, max_tasks_per_child=self._works)


def _ready() -> None:
    """Unlike a worker of a run, it soon gives memory back and keeps few products, since it waits most of the time."""
    ignore_interrupts()
    limit_threads()
    keep_kernels()
    hold_to_one_thread()
    cache.hold_to(_CACHE_BYTES)
