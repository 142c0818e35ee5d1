"""How a process is prepared for work: one thread per task, and the store in sight."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from dicflow.engine.kernel_cache import keep_kernels

__all__ = [
    "collect_rarely",
    "hold_to_one_thread",
    "ignore_interrupts",
    "keep_memory",
    "limit_threads",
    "prepare",
    "reads_probe",
    "with_room",
]

_LIMITS = ("NUMBA_NUM_THREADS", "OPENCV_FOR_THREADS_NUM", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

_ROOM = 66_000
"""Size of a frame that begins a piece of memory of 1 MB [words of 8 bytes]."""

_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8
_KEPT_BYTES = 128 * 1024 * 1024
_ALLOCATOR = {_TRIM_THRESHOLD: _KEPT_BYTES, _MMAP_THRESHOLD: _KEPT_BYTES, _ARENA_MAX: 1}
"""Options of the C library's mallopt: freed memory is kept up to so many bytes, in one place for all threads. Fetching
it page by page for every array costs more than using it."""

_COLLECTED_OBJECTS = 500_000
"""New objects after which Python looks for unused ones that refer to one another.

Libraries that are loaded make 250,000, of which it would look at each; a run leaves some thousand unused ones, and
their arrays are no part of what refers to itself."""

T = TypeVar("T")


def with_room(call: Callable[[], T]) -> T:
    """The value of a call, in which the frames of all Python functions lie in one piece of memory.

    CPython keeps frames in pieces of 16 KB, and gives a piece back when its last frame ends. Where calls deep inside
    numba's compiler happen to cross a border, it asks the system for a piece half a million times, a third of the
    time of compiling. The frame of this function is much larger than it needs, and its piece has room for all others.
    """
    return call()


with_room.__code__ = with_room.__code__.replace(co_stacksize=_ROOM)


def prepare(setup: Callable[[], None] | None = None) -> None:
    """Hold the libraries in this process to one thread each, since every worker runs tasks beside others.

    Compiled kernels have their folder from here on.

    A library that is not loaded yet finds its limit in the environment, so that nothing is loaded only to be limited.

    setup : anything else that has to be done once in every worker
    """
    limit_threads()
    keep_kernels()
    hold_to_one_thread()
    keep_memory()
    collect_rarely()
    if setup is not None:
        setup()


def keep_memory() -> None:
    """Let arrays be made of memory that earlier ones had, where the C library has such options."""
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # not glibc
            library = ctypes.CDLL(None)
            for option, value in _ALLOCATOR.items():
                library.mallopt(option, value)


def collect_rarely() -> None:
    """Let Python look for unused objects that refer to one another less often: loading libraries makes none of them."""
    gc.set_threshold(_COLLECTED_OBJECTS)


def hold_to_one_thread() -> None:
    """The same for libraries that are loaded already; numba keeps its number per thread, so every task asks anew.

    One that another thread is just loading has no such function yet, and finds its limit in the environment.
    """
    for name, function in (("cv2", "setNumThreads"), ("numba", "set_num_threads")):
        limit = getattr(sys.modules.get(name), function, None)
        if limit is not None:
            limit(1)


def limit_threads() -> None:
    """Let libraries that are loaded from here on use one thread each, unless the environment says otherwise.

    Linear algebra in several threads sums in another order, so that one thread everywhere keeps results equal. Numba
    reads its limit again at every compilation and refuses another one than it started with, so one that is loaded
    already is left to :func:`hold_to_one_thread`.
    """
    loaded = {"NUMBA_NUM_THREADS"} if "numba" in sys.modules else set()
    os.environ.update({name: "1" for name in _LIMITS if name not in os.environ and name not in loaded})


def ignore_interrupts() -> None:
    """Leave Ctrl-C to the main process, which lets the workers finish what they are at."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def reads_probe(path: Path) -> str:
    """What stands in a file of the store, "" where this process does not see it."""
    try:
        return path.read_text(encoding="utf-8")
    except OSError:
        return ""
