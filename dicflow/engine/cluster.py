"""Jobs on a scheduler of dask's, and one elsewhere that is joined."""

from __future__ import annotations

import asyncio
import itertools
import logging
import time
import uuid
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, wait
from contextlib import contextmanager, suppress
from operator import itemgetter
from typing import Any, NamedTuple

import distributed

from dicflow.engine.job_queue import JobQueue
from dicflow.engine.processes import WorkerLost
from dicflow.engine.records import sources, versions
from dicflow.engine.schedulers import Backend, BackendOptions
from dicflow.engine.store import Store
from dicflow.engine.work import KILLED, Defect, Job, Outcome, Perform, perform
from dicflow.engine.workers import ignore_interrupts, prepare, reads_probe
from dicflow.errors import ConfigurationError, StoreError, WorkerError

__all__ = ["ClusterBackend", "checked_backend", "remote_cluster"]

_MUST_AGREE = ("python", "dicflow", "dask", "distributed", "numpy", "scipy", "numba", "opencv-python-headless")
_PATIENCE_S = 15
_LOOK_S = 2.0
"""How often the workers of a scheduler are counted while nothing ends."""
_WITHOUT_WORKERS_S = 120.0
"""A scheduler may be without workers for so long."""
_CERTIFICATES = "DASK_DISTRIBUTED__COMM__TLS__CA_FILE, …__CLIENT__CERT and …__CLIENT__KEY to files in PEM"
_OTHER_SOURCE = "runs different dicflow source; install this version there and restart it"
_ENDED = "the scheduler has ended or cannot be reached; start it again, then run again: what is done is kept"
_LOST = (distributed.KilledWorker, WorkerLost)
_WINDOW = 2000
"""Tasks at the scheduler at once."""
_AT_A_TIME = 50
"""Tasks handed over before those that have ended are looked at again."""


class ClusterBackend:
    """Runs jobs on a cluster.

    link : address of the dashboard, "" without one
    retries : of a task with a defect
    perform : what a worker of dask's calls with a job
    patience_s : how long the scheduler may be without workers [s]
    """

    def __init__(
        self,
        client: distributed.Client,
        link: str,
        retries: int,
        perform: Perform = perform,
        patience_s: float = _WITHOUT_WORKERS_S,
    ) -> None:
        self.link = link
        self._watch = _Watch(client, patience_s)
        self._client = client
        self._retries = retries
        self._perform = perform

    def compute(
        self, jobs: Iterator[Job], outcomes: Mapping[str, Outcome], finished: Callable[[Outcome], None]
    ) -> None:
        """Run jobs, a window of them at once.

        A task that was lost with its worker is run once more with the cluster to itself: the worker may have died of
        what ran beside it, and alone a task has all the memory. What comes after it then goes on as usual.

        Raises WorkerError where the scheduler ends, or is without workers for long.
        """
        lost = self._window(outcomes, finished).compute(jobs)
        while lost:
            for job in [job for job in lost if all(name in outcomes for name in job.awaited())]:
                if self._window(outcomes, finished).compute(iter([job])):
                    finished(job.outcome("failed", error=f"{job.task.name}: {KILLED}"))
            left = (job for job in lost if job.task.name not in outcomes)
            lost = self._window(outcomes, finished).compute(itertools.chain(left, jobs))

    def _window(self, outcomes: Mapping[str, Outcome], finished: Callable[[Outcome], None]) -> _Window:
        return _Window(self._client, self._watch, self._retries, self._perform, outcomes, finished)


class _Inside(NamedTuple):
    """A task at the scheduler."""

    rank: int
    job: Job
    future: distributed.Future


class _Window:
    """A bounded number of tasks at the scheduler; when one ends, the next one is handed over.

    A task is handed over once its producers have ended, and takes their outcomes. The step of a chain is handed over
    with the future of the step before it, so that a worker goes on with the chain without asking the client. An early
    job has priority over a late one.
    """

    def __init__(
        self,
        client: distributed.Client,
        watch: _Watch,
        retries: int,
        perform: Perform,
        outcomes: Mapping[str, Outcome],
        finished: Callable[[Outcome], None],
    ) -> None:
        self._client = client
        self._retries = retries
        self._perform = perform
        self._watch = watch
        self._outcomes = outcomes
        self._finished = finished
        self._suffix = uuid.uuid4().hex[:6]  # dask must not take a second attempt for the first one
        self._ended = distributed.as_completed(loop=client.loop)
        self._inside: dict[str, _Inside] = {}
        self._names: dict[tuple[str, ...], str] = {}
        self._lost: list[tuple[int, Job]] = []

    def compute(self, jobs: Iterator[Job]) -> list[Job]:
        """Run jobs until none can begin; returns in order those that were lost with a worker, or wait for one."""
        queue = JobQueue(jobs, self._outcomes, self._inside)
        try:
            waits = self._fill(queue)
            while not (waits and self._ended.is_empty()):
                self._take(self._next_batch(waits), queue)
                waits = self._fill(queue)
        except distributed.client.ClosedClientError as error:
            raise WorkerError(f"{self._watch.address}: {_ENDED}") from error
        finally:
            if self._client.status == "running":
                self._client.cancel([inside.future for inside in self._inside.values()])
        return [job for _, job in sorted([*self._lost, *queue.waiting()], key=itemgetter(0))]

    def _fill(self, queue: JobQueue) -> bool:
        """Hand over the next jobs, a few at a time; returns whether the window is full or no other job can begin."""
        for _ in range(_AT_A_TIME):
            entry = queue.pop() if len(self._inside) < _WINDOW else None
            if entry is None:
                return True
            rank, job = entry
            missing = next((one for one in job.known_inputs(self._outcomes) if one.ref is None), None)
            if missing is not None:
                self._finished(perform(job, missing))
            else:
                self._hand_over(rank, job)
            queue.release(job.task.name)
        return False

    def _hand_over(self, rank: int, job: Job) -> None:
        inputs = [self._outcomes.get(name) or self._inside[name].future for name in job.awaited()]
        key = (*job.key, self._suffix)
        future = self._client.submit(
            self._perform, job, *inputs, key=key, priority=-rank, retries=self._retries, pure=False
        )
        self._names[key] = job.task.name
        self._inside[job.task.name] = _Inside(rank, job, future)
        self._ended.add(future)

    def _next_batch(self, waits: bool) -> list[distributed.Future]:
        """What has ended; it may be nothing unless the caller waits."""
        while waits and not self._ended.has_ready():
            self._watch.check()
            with self._ended.thread_condition:
                self._ended.thread_condition.wait(0.1)
        batch: list[distributed.Future] = self._ended.next_batch(block=False)
        return batch

    def _take(self, batch: list[distributed.Future], queue: JobQueue) -> None:
        """Take in what has ended, products first: an error is judged by the outcomes before it.

        An outcome may be lost with its worker before it is here; dask then makes it again.
        """
        done = [future for future in batch if future.status == "finished"]
        for outcome in self._gathered(done) if done else ():
            self._finished(outcome)
        for inside in sorted((self._inside[self._names[future.key]] for future in batch), key=itemgetter(0)):
            if inside.job.task.name in self._outcomes or inside.future.status in ("error", "cancelled"):
                self._leave(inside)
                queue.release(inside.job.task.name)
            else:
                self._ended.add(inside.future)

    def _gathered(self, done: list[distributed.Future]) -> list[Outcome]:
        """The outcomes of ended tasks. Raises WorkerError where the cluster cannot give them."""
        gather = self._client.gather(done, errors="skip", asynchronous=True)
        found = asyncio.run_coroutine_threadsafe(gather, self._client.loop.asyncio_loop)
        while not found.done():
            wait([found], timeout=1.0)
            self._watch.check()
        try:
            outcomes: list[Outcome] = found.result()
            return outcomes
        except (OSError, CancelledError) as error:
            raise WorkerError(f"{self._watch.address}: {_ENDED}") from error

    def _leave(self, inside: _Inside) -> None:
        del self._inside[inside.job.task.name], self._names[inside.future.key]
        if inside.job.task.name not in self._outcomes:
            self._erred(*inside)

    def _erred(self, rank: int, job: Job, future: distributed.Future) -> None:
        """Dask gives the error of a task also to those that need it; those lack an outcome or product to take.

        A task without an error was cancelled, because its scheduler was away for a moment.
        """
        self._watch.check()
        inputs = job.known_inputs(self._outcomes)
        missing = next((one for one in inputs if one.ref is None), None)
        error = None if future.status == "cancelled" else future.exception()
        if missing is not None:
            self._finished(perform(job, missing))
        elif len(inputs) < len(job.awaited()) or error is None or isinstance(error, _LOST):
            self._lost.append((rank, job))
        elif isinstance(error, WorkerError):
            raise error
        else:
            self._finished(_failed(job, error))


class _Watch:
    """Tells whether a scheduler can still make progress."""

    def __init__(self, client: distributed.Client, patience_s: float) -> None:
        self.address = client.scheduler.address
        self._patience_s = patience_s
        self._client = client
        self._looked = self._had_workers = time.monotonic()

    def check(self) -> None:
        """Raises WorkerError where the scheduler has ended, or has had no workers for long."""
        if self._client.status != "running":
            raise WorkerError(f"{self.address}: {_ENDED}")
        now = time.monotonic()
        if now - self._looked < _LOOK_S:
            return
        self._looked = now
        with suppress(OSError):
            if self._client.nthreads():
                self._had_workers = now
        if now - self._had_workers > self._patience_s:
            lacking = f"has had no worker for {self._patience_s:.0f} s"
            raise WorkerError(f"{self.address}: {lacking}; start 'dask worker {self.address}', then run again")


class _Client(distributed.Client):  # type: ignore[misc]
    """A client whose thread also ends where no scheduler answers."""

    def start(self, **options: Any) -> None:
        """Called by dask as the client is made."""
        try:
            super().start(**options)
        except BaseException:
            self.close()
            self._loop_runner.stop()  # close leaves it running where the client never was
            raise


@contextmanager
def remote_cluster(options: BackendOptions) -> Iterator[Backend]:
    """Workers of a running scheduler, at ``tcp://host:port``, or ``tls://host:port`` with dask's own certificates.

    Raises ConfigurationError where certificates are missing, it does not answer, has no workers or other versions or
    another source of dicflow, and StoreError where a worker does not see the store.
    """
    address = options.scheduler
    _check_certificates(address)
    try:
        client = _Client(address, timeout=_PATIENCE_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        stranger = " to these certificates" if address.startswith("tls://") else ""
        message = f"{address}: no scheduler answers there{stranger}; start 'dask scheduler' first"
        raise ConfigurationError(message) from error
    with distributed.utils.silence_logging_cmgr(logging.CRITICAL), client:
        _await_workers(client, address)
        yield checked_backend(client, address, options, client.dashboard_link, _WITHOUT_WORKERS_S)


def checked_backend(
    client: distributed.Client, name: str, options: BackendOptions, link: str, patience_s: float
) -> Backend:
    """A backend of the workers that a client has, which are checked and prepared.

    name : of their scheduler, in messages
    link : address of its dashboard, "" without one
    patience_s : how long it may be without workers later [s]
    Raises ConfigurationError and StoreError as :func:`remote_cluster` does.
    """
    _check_workers(client)
    _check_store(client, name, options.store, options.run_id)
    client.register_plugin(_Prepare(options.setup))
    return ClusterBackend(client, link, options.retries, patience_s=patience_s)


class _Prepare(distributed.WorkerPlugin):  # type: ignore[misc]
    """Prepares every worker, also one that takes the place of a dead one."""

    name = "dicflow"

    def __init__(self, setup: Callable[[], None] | None) -> None:
        self._setup = setup

    def setup(self, worker: distributed.Worker) -> None:
        """Called by dask in the new worker."""
        if worker.nanny is not None:
            ignore_interrupts()
        prepare(self._setup)


def _failed(job: Job, error: BaseException) -> Outcome:
    """The outcome of a task with a defect, or with an error of dask's own."""
    if isinstance(error, Defect):
        return job.outcome("failed", error=str(error))
    return job.outcome("failed", error=f"{job.task.name}: {type(error).__name__}: {error}; run again")


def _check_certificates(address: str) -> None:
    if not address.startswith("tls://"):
        return
    try:
        context = distributed.Security().get_connection_args("client")["ssl_context"]
    except OSError as error:
        raise ConfigurationError(f"{address}: a certificate cannot be used ({error}); set {_CERTIFICATES}") from error
    if context is None:
        raise ConfigurationError(f"{address}: dask's settings name no certificates; set {_CERTIFICATES}")


def _await_workers(client: distributed.Client, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_PATIENCE_S)
    except TimeoutError as error:
        raise ConfigurationError(f"{address}: the scheduler has no workers; start 'dask worker {address}'") from error


def _check_workers(client: distributed.Client) -> None:
    here = versions()
    for worker, found in client.run(versions).items():
        there = {**found, "python": here["python"]} if _minor(found) == _minor(here) else found
        differing = [name for name in _MUST_AGREE if there.get(name) != here.get(name)]
        other = [f"{name} {there.get(name)} (here {here.get(name)})" for name in differing]
        if other:
            raise ConfigurationError(f"{worker}: has {', '.join(other)}; install the same versions there and here")
    code = sources()
    for worker, found_code in client.run(sources).items():
        if found_code != code:
            raise ConfigurationError(f"{worker}: {_OTHER_SOURCE}")


def _minor(found: Mapping[str, str]) -> list[str]:
    """Python's version without the last number, which does not matter here."""
    return found["python"].split(".")[:2]


def _check_store(client: distributed.Client, address: str, store: Store, run_id: str) -> None:
    token, path = uuid.uuid4().hex, store.path / "runs" / run_id / "probe"
    with store.writing():
        path.write_text(token, encoding="utf-8")
    blind = [worker for worker, text in client.run(reads_probe, path).items() if text != token]
    path.unlink()
    if blind:
        raise StoreError(f"{address}: the worker {blind[0]} does not see {store.path}; put the store on a shared disk")
