"""Jobs on this machine: in turn in this process, in its threads, or in worker processes."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from dicflow.engine.compilation import Uncompiled
from dicflow.engine.handover import handover_folder
from dicflow.engine.job_queue import JobQueue
from dicflow.engine.processes import WorkerLost, survive
from dicflow.engine.schedulers import Backend, BackendOptions
from dicflow.engine.work import KILLED, Defect, Job, Outcome, Perform, perform
from dicflow.engine.workers import prepare, with_room

__all__ = ["in_process", "in_processes"]


@contextmanager
def in_process(options: BackendOptions) -> Iterator[Backend]:
    """A backend that runs jobs in this process: one worker in the calling thread, more in threads."""
    prepare(options.setup)
    ended = threading.Event()
    loading = threading.Thread(target=_call_until, args=(ended, options.ahead), daemon=True)
    loading.start()
    try:
        yield _InTurn(options) if options.workers == 1 else _AtOnce(options, _here)
    finally:
        ended.set()
        loading.join()


@contextmanager
def in_processes(options: BackendOptions) -> Iterator[Backend]:
    """A backend that runs jobs in the worker processes of the run."""
    assert options.processes is not None
    with handover_folder(options.store) if options.workers > 1 else nullcontext() as folder:
        yield _AtOnce(options, options.processes.call, folder)


def _call_until(ended: threading.Event, calls: Sequence[Callable[[], None]]) -> None:
    """Make calls in turn until an event; what goes wrong shows again in a task, which has a place for errors."""
    for call in calls:
        if ended.is_set():
            return
        with suppress(Exception):
            call()


def _here(function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)


class _InTurn:
    """Runs one job after the other; a stage is compiled before its first job."""

    link = ""

    def __init__(self, options: BackendOptions) -> None:
        self._retries = options.retries
        self._compilation = options.compilation

    def compute(
        self, jobs: Iterator[Job], outcomes: Mapping[str, Outcome], finished: Callable[[Outcome], None]
    ) -> None:
        """Run jobs in their order."""
        uncompiled = Uncompiled(self._compilation.pieces)
        for job in jobs:
            while (piece := uncompiled.take(job.task.stage)) is not None:
                self._compilation.began(job.task.stage)
                self._compilation.ended(job.task.stage, _compiled(piece[2]))
            finished(_attempted(perform, self._retries, job, job.known_inputs(outcomes)))


def _compiled(call: Callable[[], None]) -> float:
    """Compile; returns the processor time [s]. What goes wrong shows again in a task, which has a place for errors."""
    start = time.thread_time()
    with suppress(Exception):
        with_room(call)
    return time.thread_time() - start


class _AtOnce:
    """Runs as many jobs at once as there are workers, the first ones first.

    call : calls a function in a worker; may raise WorkerLost
    handover : folder through which workers hand over products, if they do
    """

    link = ""

    def __init__(self, options: BackendOptions, call: Callable[..., Any], handover: Path | None = None) -> None:
        self._options = options
        self._call = call
        self._handover = handover

    def compute(
        self, jobs: Iterator[Job], outcomes: Mapping[str, Outcome], finished: Callable[[Outcome], None]
    ) -> None:
        """Run jobs; a worker that gets free takes the first job that can begin."""
        threads = ThreadPoolExecutor(self._options.workers)
        try:
            handed = (replace(job, handover=self._handover) for job in jobs)
            _Flow(self._options, self._call, threads, handed, outcomes, finished).run()
        finally:
            threads.shutdown(wait=False, cancel_futures=True)


class _Flow:
    """The jobs of one run on their way through threads, each of which waits for one job.

    Until worker processes have started, quick jobs are done in this one.

    A job is tried again where its worker dies, so often as ``retries`` says but at least once. After that it is run
    once more when nothing runs beside it: the worker may have died of what did, and alone a job has all the memory.

    One worker compiles, piece by piece, and others that have nothing to do; numba of one process compiles one after the
    other. The jobs of a stage wait for its pieces, those of other stages begin.
    """

    def __init__(
        self,
        options: BackendOptions,
        call: Callable[..., Any],
        threads: ThreadPoolExecutor,
        jobs: Iterator[Job],
        outcomes: Mapping[str, Outcome],
        finished: Callable[[Outcome], None],
    ) -> None:
        self._call = call
        self._options = options
        self._threads = threads
        self._outcomes = outcomes
        self._finished = finished
        self._uncompiled = Uncompiled(options.compilation.pieces)
        self._queue = JobQueue(jobs, outcomes, held=self._uncompiled)
        self._compiling: dict[Future[float], tuple[str, str]] = {}
        self._running: dict[Future[Outcome], Job] = {}
        self._free = 0
        self._is_prepared = False
        self._lost: list[Job] = []

    def run(self) -> None:
        """Run jobs until none can begin. Raises WorkerError where no worker is left."""
        retries, at_once = self._options.retries, self._options.workers
        while True:
            if not self._compiling:
                self._compile_next()
            jobs = self._ready(at_once - self._busy())
            while self._options.processes is not None and self._busy() + len(jobs) < at_once and self._compile_next():
                pass
            threads = self._threads_each(self._busy() + len(jobs))
            for job in jobs:
                self._submit(replace(job, threads=threads), deaths=max(1, retries))
            if self._busy():
                self._take()
            elif self._lost:
                self._run_alone(self._lost.pop(0))
            else:
                return

    def _ready(self, at_most: int) -> list[Job]:
        """The next jobs that can begin."""
        jobs: list[Job] = []
        while len(jobs) < at_most and (entry := self._queue.pop(self._free)) is not None:
            jobs.append(entry[1])
        return jobs

    def _threads_each(self, busy: int) -> int:
        """Threads of each job; in this process, whose processor time is that of all, more than one if it is alone."""
        at_once = self._options.workers
        return at_once // max(1, busy) if self._options.processes is not None or busy == 1 else 1

    def _busy(self) -> int:
        return len(self._running) + len(self._compiling)

    def _compile_next(self) -> bool:
        """Let a worker compile the next piece, if there is one; where that is not wanted any more, none is left."""
        if not self._options.compilation.is_wanted():
            self._release(self._uncompiled.give_up())
        taken = self._uncompiled.take()
        if taken is None:
            return False
        piece, stage, call = taken
        self._options.compilation.began(stage)
        self._compiling[self._threads.submit(self._call, _compiled, call)] = piece, stage
        return True

    def _release(self, stages: list[str]) -> None:
        for stage in stages:
            self._queue.release_stage(stage)

    def _end_compiling(self, future: Future[float]) -> None:
        """Release stages that wait for nothing more. A worker that died dies again in a task, which reports it."""
        piece, stage = self._compiling.pop(future)
        lost = isinstance(future.exception(), WorkerLost)
        self._options.compilation.ended(stage, 0.0 if lost else future.result())
        self._release(self._uncompiled.done(piece))

    def _submit(self, job: Job, deaths: int) -> None:
        """Begin a job. deaths : so many of its workers may die"""
        inputs = job.known_inputs(self._outcomes)
        performed = partial(survive, deaths, self._call_for(job), perform)
        future = self._threads.submit(_attempted, performed, self._options.retries, job, inputs)
        self._running[future] = job

    def _call_for(self, job: Job) -> Callable[..., Any]:
        """What calls a function in a worker, if possible in the one that has an input of the job in its memory."""
        processes = self._options.processes
        if processes is None:
            return self._call
        if job.task.node.is_quick and not processes.are_ready:
            self._prepare()
            return _here
        near = [*job.workers_before(self._outcomes), *job.workers(self._outcomes)]
        return partial(self._call, preferred=near)

    def _prepare(self) -> None:
        """Make this process ready for jobs, once."""
        if not self._is_prepared:
            prepare(self._options.setup)
            self._is_prepared = True

    def _take(self) -> None:
        """Wait for the next job to end, and take it in."""
        waiting: list[Future[Any]] = [*self._running, *self._compiling]
        for future in wait(waiting, return_when=FIRST_COMPLETED).done:
            if future in self._compiling:
                self._end_compiling(future)
                continue
            job = self._running.pop(future)
            if isinstance(future.exception(), WorkerLost):
                self._lost.append(job)
            else:
                self._end(future.result())

    def _run_alone(self, job: Job) -> None:
        self._submit(job, deaths=0)
        self._take()
        if self._lost and self._lost[-1] is job:
            self._lost.pop()
            self._end(job.outcome("failed", error=f"{job.task.name}: {KILLED}"))

    def _end(self, outcome: Outcome) -> None:
        self._free = outcome.worker
        self._finished(outcome)
        self._queue.release(outcome.name)


def _attempted(perform: Perform, retries: int, job: Job, inputs: list[Outcome]) -> Outcome:
    """Do a task, again after a defect as often as allowed."""
    for _ in range(retries):
        try:
            return perform(job, *inputs)
        except Defect:
            continue
    try:
        return perform(job, *inputs)
    except Defect as defect:
        return job.outcome("failed", error=str(defect))
