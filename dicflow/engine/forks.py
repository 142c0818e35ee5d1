"""Worker processes as copies of one that has loaded their libraries.

Each worker would load the same libraries and compiled kernels, which takes longer than many a task. One process loads
them once, in a single thread, and forks the workers. They share its memory until they write to it. It lives as long as
the run that it serves, so that the next run finds code that has changed since. It waits for its workers at its end,
so that their processor time counts as that of the process that started it.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import sys
import threading
import weakref
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.reduction import recv_handle, send_handle

__all__ = ["ForkedProcess", "Forks", "can_fork"]

_START_S = 60.0
"""Patience with the process that loads the libraries."""
_END_S = 5.0
"""The same when it is asked to end."""
_SPAWN = multiprocessing.get_context("spawn")


def can_fork() -> bool:
    """Whether this system can: libraries of other systems than Linux do not stand it."""
    return sys.platform == "linux" and hasattr(os, "pidfd_open")


class ForkedProcess:
    """A process that was forked elsewhere, with the methods of one of ``multiprocessing``.

    pid : of the process; it stays taken until the process that forked it ends
    """

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._handle = os.pidfd_open(pid)
        weakref.finalize(self, os.close, self._handle)

    def is_alive(self) -> bool:
        """Whether it has not ended."""
        return not wait([self._handle], 0.0)

    def kill(self) -> None:
        """End it at once."""
        with suppress(ProcessLookupError):
            signal.pidfd_send_signal(self._handle, signal.SIGKILL)

    def join(self, timeout: float) -> None:
        """Wait for its end, so many seconds at most."""
        wait([self._handle], timeout)


class Forks:
    """Forks processes from one that is started for the first of them. Threads may share it.

    name : of that process
    load : loads what they share; serve : what each does with its pipe, until it ends. Functions of modules
    """

    def __init__(self, name: str, load: Callable[[], None], serve: Callable[[Connection], None]) -> None:
        self._name, self._load, self._serve = name, load, serve
        self._process: multiprocessing.process.BaseProcess | None = None
        self._pipe: Connection | None = None
        self._lock = threading.Lock()

    def fork(self, pipe: Connection) -> ForkedProcess | None:
        """A process that serves a pipe, of which this one can close its copy; None after a failure.

        Raises EOFError or OSError where it fails. A process may serve the pipe even then, so that it cannot be used.
        """
        with self._lock:
            if self._process is None:
                self._start()
            if self._pipe is None:
                return None
            try:
                return self._forked(self._pipe, pipe)
            except (EOFError, OSError):
                self._give_up()
                raise

    def _start(self) -> None:
        self._pipe, there = _SPAWN.Pipe()
        try:
            arguments = (there, self._load, self._serve)
            self._process = _SPAWN.Process(target=_fork_all, args=arguments, name=self._name, daemon=True)
            self._process.start()
        finally:
            there.close()

    def _forked(self, forks: Connection, pipe: Connection) -> ForkedProcess:
        """Raises EOFError or OSError where the other process has died or does not answer."""
        send_handle(forks, pipe.fileno(), self._process.pid if self._process is not None else None)
        if not forks.poll(_START_S):
            raise TimeoutError
        return ForkedProcess(forks.recv())

    def _close(self) -> None:
        if self._pipe is not None:
            self._pipe.close()
            self._pipe = None

    def _give_up(self) -> None:
        """Fork no more."""
        self._close()
        if self._process is not None and self._process.pid is not None:
            self._process.kill()

    def end(self) -> None:
        """Let the process that forks end, after those that it forked."""
        with self._lock:
            self._close()
            if self._process is not None and self._process.pid is not None:
                self._process.join(_END_S)
                self._process.kill()
                self._process.join(_END_S)


def _fork_all(forks: Connection, load: Callable[[], None], serve: Callable[[Connection], None]) -> None:
    """What the process that forks does until its pipe is closed."""
    load()
    gc.freeze()  # what is loaded stays, and looking through it would copy its memory
    with suppress(EOFError, OSError):
        while True:
            handle = recv_handle(forks)
            pid = os.fork()
            if pid == 0:
                forks.close()
                serve(Connection(handle))
                os._exit(0)
            os.close(handle)
            forks.send(pid)
    with suppress(ChildProcessError):
        while True:
            os.wait()
    os._exit(0)
