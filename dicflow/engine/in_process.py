"""Jobs in this process: in turn, or in threads."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager

from dicflow.engine.job_queue import JobQueue
from dicflow.engine.schedulers import Backend, BackendOptions
from dicflow.engine.work import Defect, Job, Outcome, perform
from dicflow.engine.workers import prepare

__all__ = ["in_process"]


@contextmanager
def in_process(options: BackendOptions) -> Iterator[Backend]:
    """A backend that runs jobs in this process: one worker in the calling thread, more in threads."""
    prepare(options.setup)
    yield _InTurn(options.retries) if options.workers == 1 else _InThreads(options.workers, options.retries)


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
            finished(_attempted(job, job.known_inputs(outcomes), self._retries))


class _InThreads:
    """Runs as many jobs at once as there are threads, the first ones first."""

    link = ""

    def __init__(self, threads: int, retries: int) -> None:
        self._threads = threads
        self._retries = retries

    def compute(
        self, jobs: Iterator[Job], outcomes: Mapping[str, Outcome], finished: Callable[[Outcome], None]
    ) -> None:
        """Run jobs; a thread that gets free takes the first job that can begin."""
        queue = JobQueue(jobs, outcomes)
        pool = ThreadPoolExecutor(self._threads)
        running: set[Future[Outcome]] = set()
        try:
            while True:
                while len(running) < self._threads and (entry := queue.pop()) is not None:
                    _, job = entry
                    running.add(pool.submit(_attempted, job, job.known_inputs(outcomes), self._retries))
                if not running:
                    break
                ended, running = wait(running, return_when=FIRST_COMPLETED)
                for future in ended:
                    finished(future.result())
                    queue.release(future.result().name)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _attempted(job: Job, inputs: list[Outcome], retries: int) -> Outcome:
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
