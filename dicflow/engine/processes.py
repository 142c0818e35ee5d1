"""Worker processes of this machine. Each has a pipe of its own to this process, and nothing listens.

So nobody else can connect. A worker that dies is replaced; its replacement gets work once it has said that it is
ready, so that a slow one holds up only itself. Several workers that load the same are forked from one that has.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from dicflow.engine.forks import ForkedProcess, Forks, can_fork
from dicflow.engine.workers import limit_threads, prepare, with_room
from dicflow.errors import ConfigurationError, WorkerError

__all__ = ["WorkerLost", "WorkerProcesses", "called_cpu_s", "survive"]

_START_S = 60.0
"""A worker that is not ready after this time is given up."""
_STARTS = 2
"""Attempts to start a worker in one place."""
_END_S = 5.0
"""Patience with a worker that is asked to end, before it is killed."""
_NAME = "dicflow worker"
_GUARD = "put what it does below a line  if __name__ == '__main__':"
_SPAWN = multiprocessing.get_context("spawn")

_calls_s: list[float] = []
"""Processor time of each call in a worker process of this one [s]."""

T = TypeVar("T")


def called_cpu_s() -> float:
    """Processor time of all calls so far in worker processes of this one [s]."""
    return sum(_calls_s)


class WorkerLost(Exception):
    """A worker died while it did what it was asked."""


class WorkerProcesses:
    """Calls functions of modules in processes, one call at a time in each. Threads may share it; use it as a context.

    count : processes at most; each is started when there is work for it, or by :meth:`start`
    setup : called once in every worker
    ahead : calls that each worker makes while it waits for work, one after the other, such as loading libraries
    """

    def __init__(
        self, count: int, setup: Callable[[], None] | None = None, ahead: Sequence[Callable[[], None]] = ()
    ) -> None:
        self.count = count
        self._serve = partial(_serve, setup=setup, ahead=ahead)
        self._forks = _forks(setup, ahead) if count > 1 and ahead and can_fork() else None
        self._unstarted = count
        self._places = count
        self._idle = _Idle()
        self._workers: set[_Worker] = set()
        self._closed = False
        self._ready = threading.Event()
        self._problem = ""
        self._lock = threading.Lock()
        self._variables: set[str] = set()

    def __enter__(self) -> WorkerProcesses:
        """Raises ConfigurationError in a worker, which imports the script that it serves."""
        if multiprocessing.current_process().name == _NAME:
            raise ConfigurationError(f"worker processes import the script again; {_GUARD}")
        before = set(os.environ)
        limit_threads()  # also of libraries that the script loads before a worker is prepared
        self._variables = os.environ.keys() - before
        return self

    def __exit__(self, *error: object) -> None:
        loaded = {"NUMBA_NUM_THREADS"} if "numba" in sys.modules else set()  # it reads its limit again when it compiles
        for name in self._variables - loaded:
            os.environ.pop(name, None)
        with self._lock:
            self._closed = True
            workers = list(self._workers)
        busy = set(workers)
        for worker in self._idle.take_all():
            worker.dismiss()
            busy.discard(worker)
        self._idle.put(None)
        for worker in busy:
            worker.process.kill()
        for worker in workers:
            worker.end()
        if self._forks is not None:
            self._forks.end()

    @property
    def are_ready(self) -> bool:
        """Whether one has started."""
        return self._ready.is_set()

    def start(self) -> None:
        """Start all processes now, so that they are ready when there is work."""
        with self._lock:
            for _ in range(self._unstarted):
                self._start()
            self._unstarted = 0

    def call(self, function: Callable[..., T], *arguments: Any, preferred: Sequence[int] = ()) -> T:
        """The value of a function, computed in a worker; waits for a free one.

        preferred : ids of the processes of workers that are taken before others that are free, in this order
        Raises what the function raises, WorkerLost, and WorkerError where no worker can be started.
        """
        worker = self._free(preferred)
        try:
            succeeded, value, cpu_s = worker.ask(function, arguments)
        except (EOFError, OSError):
            self._replace(worker)
            raise WorkerLost from None
        except BaseException:
            self._idle.put(worker)
            raise
        _calls_s.append(cpu_s)
        self._idle.put(worker)
        if not succeeded:
            raise value
        found: T = value
        return found

    def map(self, function: Callable[..., T], items: Iterable[Any]) -> Iterator[T]:
        """The function's values for some items, in their order, with all workers at once.

        Raises what the function raises, and WorkerError where workers cannot be started or die again and again.
        """
        threads = ThreadPoolExecutor(self.count)
        try:
            yield from threads.map(partial(self._called, function), items)
        finally:
            threads.shutdown(wait=False, cancel_futures=True)

    def _called(self, function: Callable[..., T], item: Any) -> T:
        try:
            found: T = survive(1, self.call, function, item)
            return found
        except WorkerLost:
            raise WorkerError("a worker was killed twice at the same work, probably out of memory; use fewer") from None

    def _free(self, preferred: Sequence[int]) -> _Worker:
        while True:
            with self._lock:
                if self._unstarted and not self._idle:
                    self._unstarted -= 1
                    self._start()
            worker = self._idle.get(preferred)
            if worker is None:
                self._idle.put(None)
                remedy = "'dicflow run --scheduler threads' needs none"
                raise WorkerError(f"no worker process starts, tried {_STARTS} times{self._problem}; {remedy}")
            if worker.process.is_alive():
                return worker
            self._replace(worker)

    def _replace(self, worker: _Worker) -> None:
        self._drop(worker)
        self._start()

    def _drop(self, worker: _Worker) -> None:
        with self._lock:
            self._workers.discard(worker)
        worker.process.kill()
        worker.end()

    def _start(self) -> None:
        threading.Thread(target=self._bring_up, daemon=True).start()

    def _bring_up(self) -> None:
        """Start a worker and wait until it is ready; the place is given up where none gets ready."""
        for _ in range(_STARTS):
            worker = self._launched()
            if worker is not None and worker.is_ready():
                self._ready.set()
                self._idle.put(worker)
                return
            if worker is not None:
                self._drop(worker)
        self._give_up()

    def _launched(self) -> _Worker | None:
        """A worker that leaves Ctrl-C and the loss of the terminal to this process; None where it cannot be started."""
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})  # of this thread, and inherited
        with self._lock:
            if self._closed:
                return None
            try:
                worker = _Worker(self._process)
            except Exception as error:
                self._problem = f": {error}"
                return None
            self._workers.add(worker)
            return worker

    def _process(self, pipe: Connection) -> BaseProcess | ForkedProcess:
        """A new process that serves a pipe."""
        forked = self._forks.fork(pipe) if self._forks is not None else None
        if forked is not None:
            return forked
        process = _SPAWN.Process(target=self._serve, args=(pipe,), name=_NAME, daemon=True)
        process.start()
        return process

    def _give_up(self) -> None:
        """Leave a place without a worker; another place takes over, as long as there is one."""
        with self._lock:
            self._places -= 1
            if self._unstarted:
                self._unstarted -= 1
                self._start()
            elif self._places == 0:
                self._idle.put(None)


def survive(deaths: int, call: Callable[..., T], *arguments: Any) -> T:
    """The value of a call that is made again where its worker dies, so often at most. Raises WorkerLost after that."""
    for _ in range(deaths):
        with suppress(WorkerLost):
            return call(*arguments)
    return call(*arguments)


class _Idle:
    """Workers that have nothing to do, the one that has waited longest first. None means that there will be no more."""

    def __init__(self) -> None:
        self._waiting: list[_Worker | None] = []
        self._changed = threading.Condition()

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def put(self, worker: _Worker | None) -> None:
        """Add one."""
        with self._changed:
            self._waiting.append(worker)
            self._changed.notify()

    def get(self, preferred: Sequence[int]) -> _Worker | None:
        """Take the first of the preferred ones, or else the first one; waits for it."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting)
            ids = [None if worker is None else worker.process.pid for worker in self._waiting]
            return self._waiting.pop(next((ids.index(one) for one in preferred if one in ids), 0))

    def take_all(self) -> list[_Worker]:
        """Take all that wait."""
        with self._changed:
            found, self._waiting = self._waiting, []
        return [worker for worker in found if worker is not None]


class _Worker:
    """A process and this end of its pipe. start : starts a process that serves the other end"""

    def __init__(self, start: Callable[[Connection], BaseProcess | ForkedProcess]) -> None:
        self._pipe, there = _SPAWN.Pipe()
        try:
            self.process = start(there)
        finally:
            there.close()

    def is_ready(self) -> bool:
        """Wait until it says so; False where it dies before or takes too long."""
        try:
            return self._pipe.poll(_START_S) and bool(self._pipe.recv())
        except (EOFError, OSError):
            return False

    def ask(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[bool, Any, float]:
        """Whether a call succeeded, its value or error, and its processor time [s].

        Raises EOFError or OSError where the worker dies.
        """
        self._pipe.send((function, arguments))
        return self._pipe.recv()  # type: ignore[no-any-return]

    def dismiss(self) -> None:
        """Let it end by itself, which it does at once unless it is at work."""
        self._pipe.close()

    def end(self) -> None:
        """Wait for its end, and enforce it after a while."""
        self.process.join(_END_S)
        if self.process.is_alive():
            self.process.kill()
            self.process.join(_END_S)


def _forks(setup: Callable[[], None] | None, ahead: Sequence[Callable[[], None]]) -> Forks:
    """What forks workers that have made the calls ahead."""
    return Forks(_NAME, partial(_load, setup, ahead), partial(_serve_with_parent, ahead=()))


def _load(setup: Callable[[], None] | None, ahead: Sequence[Callable[[], None]]) -> None:
    _begin(setup)
    with_room(partial(_call_all, ahead))


def _serve(pipe: Connection, setup: Callable[[], None] | None, ahead: Sequence[Callable[[], None]]) -> None:
    """What a worker does until its pipe is closed."""
    _begin(setup)
    _serve_with_parent(pipe, ahead)


def _begin(setup: Callable[[], None] | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the main process lets the workers finish
    with suppress(ValueError):  # with this, locks that libraries make leave no names behind when a worker is killed
        multiprocessing.set_start_method("fork", force=True)
    prepare(setup)


def _serve_with_parent(pipe: Connection, ahead: Sequence[Callable[[], None]]) -> None:
    """Answer requests as long as the main process lives and the pipe is open."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # the other end is closed, or its process has died
        pipe.send(True)
        with_room(partial(_answer_all, pipe, ahead))
    _leave()


def _leave() -> None:
    """End this process at once: the system takes back what it loaded faster than Python takes it apart."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):
            stream.flush()
    os._exit(0)


def _answer_all(pipe: Connection, ahead: Sequence[Callable[[], None]]) -> None:
    """Answer requests with whether they succeeded, value or error, and processor time. Raises EOFError at the end."""
    to_do = iter(ahead)
    while True:
        while not pipe.poll() and (call := next(to_do, None)) is not None:
            _call_all([call])
        request, before = pipe.recv_bytes(), time.process_time()
        pipe.send((*_answer(request), time.process_time() - before))


def _call_all(calls: Sequence[Callable[[], None]]) -> None:
    for call in calls:
        with suppress(Exception):  # what goes wrong shows again in a task, which has a place for errors
            call()


def _answer(request: bytes) -> tuple[bool, Any]:
    try:
        function, arguments = pickle.loads(request)
        return True, function(*arguments)
    except Exception as error:
        return False, _portable(error)


def _portable(error: Exception) -> Exception:
    """An error that another process can read."""
    try:
        copy = pickle.loads(pickle.dumps(error))
    except Exception:
        copy = None
    return copy if type(copy) is type(error) else RuntimeError(f"{type(error).__name__}: {error}")


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
