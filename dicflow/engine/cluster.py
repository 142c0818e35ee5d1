"""Workers as processes, here or elsewhere, through dask.distributed. The only module that imports it."""

from __future__ import annotations

import logging
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import distributed

from dicflow.engine.records import versions
from dicflow.engine.store import Store
from dicflow.engine.work import Job, Outcome
from dicflow.engine.workers import ignore_interrupts, prepare, reads_probe
from dicflow.errors import ConfigurationError, StoreError

__all__ = ["ClusterBackend", "is_loopback", "local_cluster", "remote_cluster"]

_LOOPBACK = "127.0.0.1"
_MUST_AGREE = ("python", "dicflow", "dask", "distributed", "numpy")
_PATIENCE_S = 15


class ClusterBackend:
    """Runs graphs on a cluster. link : address of the dashboard, "" where there is none"""

    def __init__(self, client: distributed.Client, link: str) -> None:
        self._client = client
        self.link = link

    def compute(self, graph: Mapping[Any, Any], jobs: Mapping[Any, Job], finished: Callable[[Outcome], None]) -> None:
        """Run a graph; ``finished`` is told of every task as it ends."""
        futures = self._client.get(dict(graph), list(graph), sync=False)
        try:
            for future in distributed.as_completed(futures, loop=self._client.loop):
                error = future.exception()
                job = jobs[future.key]
                finished(future.result() if error is None else _lost(job, error, future.key))
        finally:
            self._client.cancel(futures)


@contextmanager
def local_cluster(
    workers: int, *, processes: bool, dashboard: bool, setup: Callable[[], None] | None
) -> Iterator[ClusterBackend]:
    """Workers on this machine, reachable from this machine only.

    workers : processes with one thread each, or threads of this process
    """
    address = f"{_LOOPBACK}:0" if dashboard else None
    options: dict[str, Any] = {"n_workers": workers, "threads_per_worker": 1}
    if not processes:
        options = {"n_workers": 1, "threads_per_worker": workers, "worker_dashboard_address": f"{_LOOPBACK}:0"}
    with (
        distributed.LocalCluster(
            processes=processes, host=_LOOPBACK, dashboard_address=address, silence_logs=logging.CRITICAL, **options
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
    Raises ConfigurationError where it does not answer, has no workers or other versions, and StoreError where a
    worker does not see the store.
    """
    try:
        client = distributed.Client(address, timeout=_PATIENCE_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigurationError(f"{address}: no scheduler answers there; start 'dask scheduler' first") from error
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


def _lost(job: Job, error: BaseException, key: Any) -> Outcome:
    """The outcome of a task that no worker could bring home, or that comes after such a one."""
    killer = getattr(error, "task", key)
    if killer != key:
        return job.outcome("skipped", error=f"{'/'.join(killer[:-1])} failed")
    if isinstance(error, distributed.KilledWorker):
        message = "its worker died again and again; most likely the memory did not suffice: use fewer workers"
        return job.outcome("failed", error=f"{job.task.name}: {message}")
    return job.outcome("failed", error=f"{job.task.name}: {type(error).__name__}: {error}; run again")


def _check_workers(client: distributed.Client, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=_PATIENCE_S)
    except TimeoutError as error:
        raise ConfigurationError(f"{address}: the scheduler has no workers; start 'dask worker {address}'") from error
    here = versions()
    for worker, there in client.run(versions).items():
        other = [
            f"{name} {there.get(name)} (here {here[name]})" for name in _MUST_AGREE if there.get(name) != here[name]
        ]
        if other:
            raise ConfigurationError(f"{worker}: has {', '.join(other)}; install the same versions there and here")


def _check_store(client: distributed.Client, address: str, store: Store, run_id: str) -> None:
    token, path = uuid.uuid4().hex, store.path / "runs" / run_id / "probe"
    with store.writing():
        path.write_text(token, encoding="utf-8")
    blind = [worker for worker, text in client.run(reads_probe, path).items() if text != token]
    path.unlink()
    if blind:
        raise StoreError(f"{address}: the worker {blind[0]} does not see {store.path}; put the store on a shared disk")
