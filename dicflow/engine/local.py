"""Jobs on this machine: in turn in this process, in its threads, or in worker processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

from dicflow.engine.job_queue import JobQueue
from dicflow.engine.processes import WorkerLost, WorkerProcesses, survive
from dicflow.engine.schedulers import Backend, BackendOptions
from dicflow.engine.work import KILLED, Defect, Job, Outcome, Perform, perform
from dicflow.engine.workers import prepare

__all__ = ["in_process", "in_processes"]


@contextmanager
def in_process(options: BackendOptions) -> Iterator[Backend]:
    """A backend that runs jobs in this process: one worker in the calling thread, more in threads."""
    prepare(options.setup)
    yield _InTurn(options.retries) if options.workers == 1 else _AtOnce(options.workers, options.retries, perform)


@contextmanager
def in_processes(options: BackendOptions) -> Iterator[Backend]:
    """A backend that runs jobs in worker processes, which end with the context."""
    with WorkerProcesses(options.workers, options.setup) as processes:
        yield _AtOnce(options.workers, options.retries, partial(processes.call, perform))


class _InTurn:
    """Runs one job after the other."""

    link = ""

    def __init__(self, retries: int) -> None:
        self._retries = retries

    def compute(
        self, jobs: Iterator[Job], outcomes: Mapping[str, Outcome], finished: Callable[[Outcome], None]
    ) -> None:
        """Run jobs in their order."""
        for job in jobs:
            finished(_attempted(perform, self._retries, job, job.known_inputs(outcomes)))


class _AtOnce:
    """Runs as many jobs at once as there are workers, the first ones first.

    perform : may raise WorkerLost
    """

    link = ""

    def __init__(self, workers: int, retries: int, perform: Perform) -> None:
        self._workers = workers
        self._retries = retries
        self._perform = perform

    def compute(
        self, jobs: Iterator[Job], outcomes: Mapping[str, Outcome], finished: Callable[[Outcome], None]
    ) -> None:
        """Run jobs; a worker that gets free takes the first job that can begin."""
        threads = ThreadPoolExecutor(self._workers)
        try:
            _Flow(self._perform, self._retries, threads, jobs, outcomes, finished).run(self._workers)
        finally:
            threads.shutdown(wait=False, cancel_futures=True)


class _Flow:
    """The jobs of one run on their way through threads, each of which waits for one job.

    A job is tried again where its worker dies, so often as ``retries`` says but at least once. After that it is run
    once more when nothing runs beside it: the worker may have died of what did, and alone a job has all the memory.
    """

    def __init__(
        self,
        perform: Perform,
        retries: int,
        threads: ThreadPoolExecutor,
        jobs: Iterator[Job],
        outcomes: Mapping[str, Outcome],
        finished: Callable[[Outcome], None],
    ) -> None:
        self._perform = perform
        self._retries = retries
        self._threads = threads
        self._outcomes = outcomes
        self._finished = finished
        self._queue = JobQueue(jobs, outcomes)
        self._running: dict[Future[Outcome], Job] = {}
        self._lost: list[Job] = []

    def run(self, at_once: int) -> None:
        """Run jobs until none can begin. Raises WorkerError where no worker is left."""
        while True:
            jobs = self._ready(at_once - len(self._running))
            threads = at_once // max(1, len(self._running) + len(jobs))
            for job in jobs:
                self._submit(replace(job, threads=threads), deaths=max(1, self._retries))
            if self._running:
                self._take()
            elif self._lost:
                self._run_alone(self._lost.pop(0))
            else:
                return

    def _ready(self, at_most: int) -> list[Job]:
        """The next jobs that can begin."""
        jobs: list[Job] = []
        while len(jobs) < at_most and (entry := self._queue.pop()) is not None:
            jobs.append(entry[1])
        return jobs

    def _submit(self, job: Job, deaths: int) -> None:
        """Begin a job. deaths : so many of its workers may die"""
        inputs = job.known_inputs(self._outcomes)
        future = self._threads.submit(_attempted, partial(survive, deaths, self._perform), self._retries, job, inputs)
        self._running[future] = job

    def _take(self) -> None:
        """Wait for the next job to end, and take it in."""
        for future in wait(self._running, return_when=FIRST_COMPLETED).done:
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
