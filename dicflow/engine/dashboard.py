"""The dashboard of a run on this machine: a scheduler of dask's within this process, which takes no connections."""

from __future__ import annotations

import logging
import socket
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import dask
import distributed

from dicflow.engine.cluster import ClusterBackend
from dicflow.engine.processes import WorkerProcesses, survive
from dicflow.engine.schedulers import Backend, BackendOptions
from dicflow.engine.work import Job, Outcome, Perform, perform
from dicflow.engine.workers import prepare

__all__ = ["dashboard_cluster"]

_LOOPBACK = "127.0.0.1"
_SATURATION = 1.0
"""Tasks at a worker per thread: the running one only, so that the next step of a chain waits for no other.

A scheduler elsewhere has its own setting (``distributed.scheduler.worker-saturation``, 1.1 unless set).
"""
_DASHBOARD = {
    "distributed.scheduler.worker-saturation": _SATURATION,
    "distributed.scheduler.http.routes": ["distributed.http.statics"],
    "distributed.worker.http.routes": [],
}
"""A scheduler within this process, without pages of logs, call stacks and figures for other programs."""
_PAGES = frozenset(("/status", "/workers", "/tasks", "/system", "/graph", "/groups", "/individual-progress"))
"""Plots that the dashboard shows: those that only look, and tell names, times and load."""
_ORIGINS = "distributed.scheduler.dashboard.bokeh-application.allow_websocket_origin"


@contextmanager
def dashboard_cluster(options: BackendOptions, *, processes: bool) -> Iterator[Backend]:
    """A scheduler within this process. Its dashboard alone listens, for those on this machine.

    processes : a thread of dask's hands its task on to a worker process, else does it
    """
    address = f"{_LOOPBACK}:{_free_port()}"
    origins = {_ORIGINS: [address]}  # pages of other origins in a browser see nothing
    with (
        tempfile.TemporaryDirectory(prefix="dicflow-") as scratch,
        dask.config.set({**_DASHBOARD, **origins, "temporary-directory": scratch}),
        _only_pages(),
        distributed.LocalCluster(
            processes=False,
            n_workers=1,
            threads_per_worker=options.workers,
            protocol="inproc://",
            memory_limit=0,
            dashboard_address=address,
            worker_dashboard_address=f"{_LOOPBACK}:0",
            silence_logs=logging.CRITICAL,
            scheduler_kwargs={"dashboard": True},
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
        _performer(options, processes) as performer,
    ):
        yield ClusterBackend(client, f"http://{address}/status", options.retries, performer)


@contextmanager
def _only_pages() -> Iterator[None]:
    """Let a dashboard that starts meanwhile have our pages only, and that of its worker none."""
    from distributed.dashboard import scheduler, worker

    every = scheduler.applications, worker.applications
    kept = {name: page for name, page in scheduler.applications.items() if name in _PAGES}
    scheduler.applications, worker.applications = kept, {}
    try:
        yield
    finally:
        scheduler.applications, worker.applications = every


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((_LOOPBACK, 0))
        return int(probe.getsockname()[1])


_PERFORMERS: dict[str, Perform] = {}
"""Those of this process by name, since dask takes a function as bytes only."""


@contextmanager
def _performer(options: BackendOptions, processes: bool) -> Iterator[Perform]:
    if not processes:
        prepare(options.setup)
        yield perform
        return
    name = uuid.uuid4().hex
    with WorkerProcesses(options.workers, options.setup) as workers:
        _PERFORMERS[name] = partial(survive, max(1, options.retries), workers.call, perform)
        try:
            yield partial(_hand_on, name)
        finally:
            del _PERFORMERS[name]


def _hand_on(name: str, job: Job, *inputs: Outcome) -> Outcome:
    return _PERFORMERS[name](job, *inputs)
