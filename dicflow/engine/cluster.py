"""Workers as processes, here or elsewhere, through dask.distributed. The only module that imports it."""

from __future__ import annotations

import logging
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import dask
import distributed

from dicflow.engine.records import sources, versions
from dicflow.engine.store import Store
from dicflow.engine.work import Job, Outcome
from dicflow.engine.workers import ignore_interrupts, prepare, reads_probe
from dicflow.errors import ConfigurationError, StoreError

__all__ = ["ClusterBackend", "is_loopback", "local_cluster", "remote_cluster"]

_LOOPBACK = "127.0.0.1"
_MUST_AGREE = ("python", "dicflow", "dask", "distributed", "numpy", "scipy", "numba", "opencv-python-headless")
_PATIENCE_S = 15
_ARRAYS = 256 * 1024 * 1024
_ALLOCATOR = {"MALLOC_TRIM_THRESHOLD_": _ARRAYS, "MALLOC_MMAP_THRESHOLD_": _ARRAYS}
"""Workers keep freed memory up to so many bytes: fetching it page by page for every array costs more than using it."""
_CERTIFICATES = "DASK_DISTRIBUTED__COMM__TLS__CA_FILE, …__CLIENT__CERT and …__CLIENT__KEY to files in PEM"
_DIED = "its worker died again and again, even with nothing beside it; most likely it needs more memory than there is"


class ClusterBackend:
    """Runs graphs on a cluster. link : address of the dashboard, "" where there is none"""

    def __init__(self, client: distributed.Client, link: str) -> None:
        self._client = client
        self.link = link

    def compute(self, graph: Mapping[Any, Any], finished: Callable[[Outcome], None]) -> None:
        """Run a graph; ``finished`` is told of every task as it ends.

        What was lost with a worker, and what comes after it, is tried once more with the cluster to itself: the worker
        may have died of what ran beside it, and alone a task has all the memory there is.
        """
        outcomes = self._run(graph, finished)
        for key in [key for key in graph if key not in outcomes]:
            call, job, *needs = graph[key]
            inputs = [need if isinstance(need, Outcome) else outcomes[need] for need in needs]
            outcomes[key] = self._alone(key, call, job, inputs, finished)

    def _alone(
        self,
        key: Any,
        call: Callable[..., Outcome],
        job: Job,
        inputs: list[Outcome],
        finished: Callable[[Outcome], None],
    ) -> Outcome:
        """Run one task with nothing beside it."""
        if all(outcome.ref is not None for outcome in inputs):
            found = self._run({(*key, "alone"): (call, job, *inputs)}, finished)
            if found:
                return next(iter(found.values()))
            outcome = job.outcome("failed", error=f"{job.task.name}: {_DIED}")
        else:
            outcome = call(job, *inputs)
        finished(outcome)
        return outcome

    def _run(self, graph: Mapping[Any, Any], finished: Callable[[Outcome], None]) -> dict[Any, Outcome]:
        """Run a graph; what is lost with its worker gets no outcome."""
        outcomes = {}
        futures = self._client.get(dict(graph), list(graph), sync=False)
        try:
            for future in distributed.as_completed(futures, loop=self._client.loop):
                error = future.exception()
                if not isinstance(error, distributed.KilledWorker):
                    _, job, *_ = graph[future.key]
                    outcomes[future.key] = future.result() if error is None else _broken(job, error)
                    finished(outcomes[future.key])
        finally:
            self._client.cancel(futures)
        return outcomes


@contextmanager
def local_cluster(
    workers: int, *, processes: bool, dashboard: bool, setup: Callable[[], None] | None
) -> Iterator[ClusterBackend]:
    """Workers on this machine, reachable from this machine only.

    workers : processes with one thread each, or threads of this process
    """
    address = f"{_LOOPBACK}:0"  # a server for the cluster's own needs listens there even without a dashboard
    options: dict[str, Any] = {"n_workers": workers, "threads_per_worker": 1}
    if not processes:
        options = {"n_workers": 1, "threads_per_worker": workers, "worker_dashboard_address": address}
        options["protocol"] = "tcp://"  # within a process dask would else talk to itself, but cannot be held to a host
    spawned = {f"distributed.nanny.pre-spawn-environ.{name}": value for name, value in _ALLOCATOR.items()}
    with (
        dask.config.set(spawned),
        distributed.LocalCluster(
            processes=processes,
            host=_LOOPBACK,
            dashboard_address=address,
            silence_logs=logging.CRITICAL,
            scheduler_kwargs={"allowed_failures": 1, "dashboard": dashboard},
            **options,
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        client.register_plugin(_Prepare(setup))
        yield ClusterBackend(client, cluster.dashboard_link if dashboard else "")


@contextmanager
def remote_cluster(
    address: str, store: Store, run_id: str, *, setup: Callable[[], None] | None
) -> Iterator[ClusterBackend]:
    """Workers of a scheduler that is already there.

    address : ``tcp://host:port``, or ``tls://host:port`` with dask's own configuration of certificates
    Raises ConfigurationError where there are no such certificates, it does not answer, has no workers or other
    versions or other code of dicflow, and StoreError where a worker does not see the store.
    """
    _check_certificates(address)
    try:
        client = distributed.Client(address, timeout=_PATIENCE_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        stranger = " to these certificates" if address.startswith("tls://") else ""
        message = f"{address}: no scheduler answers there{stranger}; start 'dask scheduler' first"
        raise ConfigurationError(message) from error
    with client:
        _check_workers(client, address)
        _check_store(client, address, store, run_id)
        client.register_plugin(_Prepare(setup))
        yield ClusterBackend(client, client.dashboard_link)


def is_loopback(address: str) -> bool:
    """Whether a scheduler's address can be reached from this machine only."""
    return urlsplit(address).hostname in ("localhost", _LOOPBACK, "::1")


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


def _broken(job: Job, error: BaseException) -> Outcome:
    """The outcome of a task that dask itself could not bring home."""
    return job.outcome("failed", error=f"{job.task.name}: {type(error).__name__}: {error}; run again")


def _check_certificates(address: str) -> None:
    if not address.startswith("tls://"):
        return
    try:
        context = distributed.Security().get_connection_args("client")["ssl_context"]
    except OSError as error:
        raise ConfigurationError(f"{address}: a certificate cannot be used ({error}); set {_CERTIFICATES}") from error
    if context is None:
        raise ConfigurationError(f"{address}: dask has been told of no certificates; set {_CERTIFICATES}")


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
            raise ConfigurationError(f"{worker}: has other code of dicflow; install the same there and start it again")


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
