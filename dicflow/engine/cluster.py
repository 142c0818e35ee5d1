"""Workers as processes, here or elsewhere, through dask.distributed. The only module that imports it."""

from __future__ import annotations

import itertools
import logging
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from operator import itemgetter
from typing import Any, NamedTuple

import dask
import distributed

from dicflow.engine.job_queue import JobQueue
from dicflow.engine.records import sources, versions
from dicflow.engine.schedulers import Backend, BackendOptions
from dicflow.engine.store import Store
from dicflow.engine.work import Defect, Job, Outcome, perform
from dicflow.engine.workers import ignore_interrupts, prepare, reads_probe
from dicflow.errors import ConfigurationError, StoreError

__all__ = ["ClusterBackend", "local_cluster", "remote_cluster"]

_LOOPBACK = "127.0.0.1"
_MUST_AGREE = ("python", "dicflow", "dask", "distributed", "numpy", "scipy", "numba", "opencv-python-headless")
_PATIENCE_S = 15
_ARRAYS = 256 * 1024 * 1024
_ALLOCATOR = {"MALLOC_TRIM_THRESHOLD_": _ARRAYS, "MALLOC_MMAP_THRESHOLD_": _ARRAYS}
"""Workers keep freed memory up to so many bytes: fetching it page by page for every array costs more than using it."""
_CERTIFICATES = "DASK_DISTRIBUTED__COMM__TLS__CA_FILE, …__CLIENT__CERT and …__CLIENT__KEY to files in PEM"
_OTHER_SOURCE = "runs different dicflow source; install this version there and restart it"
_KILLED = "its worker was killed every time, even running alone; probably out of memory"
_SATURATION = 1.0
"""Tasks at a worker per thread: the running one only, so that the next step of a chain waits for no other.

A scheduler elsewhere has its own setting (``distributed.scheduler.worker-saturation``, 1.1 unless set).
"""
_WINDOW = 2000
"""Tasks at the scheduler at once."""
_AT_A_TIME = 50
"""Tasks handed over before those that have ended are looked at again."""


class ClusterBackend:
    """Runs jobs on a cluster. link : address of the dashboard, "" without one; retries : of a task with a defect"""

    def __init__(self, client: distributed.Client, link: str, retries: int) -> None:
        self.link = link
        self._client = client
        self._retries = retries

    def compute(
        self, jobs: Iterator[Job], outcomes: Mapping[str, Outcome], finished: Callable[[Outcome], None]
    ) -> None:
        """Run jobs, a window of them at once.

        A task that was lost with its worker is run once more with the cluster to itself: the worker may have died of
        what ran beside it, and alone a task has all the memory. What comes after it then goes on as usual.
        """
        lost = self._window(outcomes, finished).compute(jobs)
        while lost:
            for job in [job for job in lost if all(name in outcomes for name in job.awaited())]:
                if self._window(outcomes, finished).compute(iter([job])):
                    finished(job.outcome("failed", error=f"{job.task.name}: {_KILLED}"))
            left = (job for job in lost if job.task.name not in outcomes)
            lost = self._window(outcomes, finished).compute(itertools.chain(left, jobs))

    def _window(self, outcomes: Mapping[str, Outcome], finished: Callable[[Outcome], None]) -> _Window:
        return _Window(self._client, self._retries, outcomes, finished)


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
        retries: int,
        outcomes: Mapping[str, Outcome],
        finished: Callable[[Outcome], None],
    ) -> None:
        self._client = client
        self._retries = retries
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
                self._take(self._ended.next_batch(block=waits), queue)
                waits = self._fill(queue)
        finally:
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
        future = self._client.submit(perform, job, *inputs, key=key, priority=-rank, retries=self._retries, pure=False)
        self._names[key] = job.task.name
        self._inside[job.task.name] = _Inside(rank, job, future)
        self._ended.add(future)

    def _take(self, batch: list[distributed.Future], queue: JobQueue) -> None:
        """Take in what has ended, products first: an error is judged by the outcomes before it.

        An outcome may be lost with its worker before it is here; dask then makes it again.
        """
        done = [future for future in batch if future.status == "finished"]
        for outcome in self._client.gather(done, errors="skip") if done else ():
            self._finished(outcome)
        for inside in sorted((self._inside[self._names[future.key]] for future in batch), key=itemgetter(0)):
            if inside.job.task.name in self._outcomes or inside.future.status in ("error", "cancelled"):
                self._leave(inside)
                queue.release(inside.job.task.name)
            else:
                self._ended.add(inside.future)

    def _leave(self, inside: _Inside) -> None:
        del self._inside[inside.job.task.name], self._names[inside.future.key]
        if inside.job.task.name not in self._outcomes:
            self._erred(*inside)

    def _erred(self, rank: int, job: Job, future: distributed.Future) -> None:
        """Dask gives the error of a task also to those that need it; those lack an outcome or product to take."""
        inputs = job.known_inputs(self._outcomes)
        missing = next((one for one in inputs if one.ref is None), None)
        error = future.exception()
        if missing is not None:
            self._finished(perform(job, missing))
        elif len(inputs) < len(job.awaited()) or isinstance(error, distributed.KilledWorker):
            self._lost.append((rank, job))
        else:
            self._finished(_failed(job, error))


@contextmanager
def local_cluster(options: BackendOptions, *, processes: bool) -> Iterator[Backend]:
    """Workers on this machine, reachable from this machine only.

    processes : workers are processes with one thread each, else threads of this process
    """
    address = f"{_LOOPBACK}:0"  # a server for the cluster's own needs listens there even without a dashboard
    layout: dict[str, Any] = {"n_workers": options.workers, "threads_per_worker": 1}
    if not processes:
        layout = {"n_workers": 1, "threads_per_worker": options.workers, "worker_dashboard_address": address}
        layout["protocol"] = "tcp://"  # within a process dask would else talk to itself, but cannot be held to a host
    settings = {f"distributed.nanny.pre-spawn-environ.{name}": value for name, value in _ALLOCATOR.items()}
    with (
        dask.config.set({**settings, "distributed.scheduler.worker-saturation": _SATURATION}),
        distributed.LocalCluster(
            processes=processes,
            host=_LOOPBACK,
            dashboard_address=address,
            silence_logs=logging.CRITICAL,
            scheduler_kwargs={"allowed_failures": max(1, options.retries), "dashboard": options.dashboard},
            **layout,
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        client.register_plugin(_Prepare(options.setup))
        yield ClusterBackend(client, cluster.dashboard_link if options.dashboard else "", options.retries)


@contextmanager
def remote_cluster(options: BackendOptions) -> Iterator[Backend]:
    """Workers of a running scheduler, at ``tcp://host:port``, or ``tls://host:port`` with dask's own certificates.

    Raises ConfigurationError where certificates are missing, it does not answer, has no workers or other versions or
    another source of dicflow, and StoreError where a worker does not see the store.
    """
    address = options.scheduler
    _check_certificates(address)
    try:
        client = distributed.Client(address, timeout=_PATIENCE_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        stranger = " to these certificates" if address.startswith("tls://") else ""
        message = f"{address}: no scheduler answers there{stranger}; start 'dask scheduler' first"
        raise ConfigurationError(message) from error
    with client:
        _check_workers(client, address)
        _check_store(client, address, options.store, options.run_id)
        client.register_plugin(_Prepare(options.setup))
        yield ClusterBackend(client, client.dashboard_link, options.retries)


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


def _check_workers(client: distributed.Client, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_PATIENCE_S)
    except TimeoutError as error:
        raise ConfigurationError(f"{address}: the scheduler has no workers; start 'dask worker {address}'") from error
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
            raise ConfigurationError(
                f"{worker}: runs different dicflow source; install this version there and restart it"
            )


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
