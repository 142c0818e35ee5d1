"""One graph, several ways to run it: in turn, in threads, in processes, on a cluster elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any, Protocol

from dicflow.engine.store import Store
from dicflow.engine.work import Job, Outcome, perform
from dicflow.engine.workers import prepare
from dicflow.errors import ConfigurationError

__all__ = ["Backend", "build_graph", "check_scheduler", "open_backend"]

GraphKey = tuple[str, ...]
"""(stage, step, run), or (stage, run) of a stage that runs once: dask's dashboard groups by the first."""


class Backend(Protocol):
    """Something that runs graphs. link : address of the dashboard, "" where there is none"""

    link: str

    def compute(self, graph: Mapping[GraphKey, Any], finished: Callable[[Outcome], None]) -> None:
        """Run a graph; ``finished`` is told of every task as it ends."""


def build_graph(jobs: Mapping[str, Job], done: Mapping[str, Outcome]) -> dict[GraphKey, tuple[Any, ...]]:
    """The plain mapping that dask runs: readable name → a call and the names of its inputs.

    jobs : task → job, every task after those it takes from
    done : outcomes of tasks that are not in this graph but stand before it
    """
    keys = {name: _key(job) for name, job in jobs.items()}

    def needs(job: Job) -> Iterator[GraphKey | Outcome]:
        for name in job.task.producers():
            if name in keys:
                yield keys[name]
            elif name not in job.known:
                yield done[name]

    return {keys[name]: (perform, job, *needs(job)) for name, job in jobs.items()}


def check_scheduler(scheduler: str, workers: int) -> None:
    """Raises ConfigurationError for a scheduler that there is not."""
    if scheduler not in ("sync", "threads", "processes") and not scheduler.startswith(("tcp://", "tls://")):
        raise ConfigurationError(
            f"no scheduler '{scheduler}'; use sync, threads, processes, or an address tcp://host:port or tls://host:port"
        )
    if workers < 1:
        raise ConfigurationError(f"{workers} workers cannot work; use 1 or more")


def open_backend(
    scheduler: str,
    *,
    workers: int,
    dashboard: bool,
    store: Store,
    run_id: str,
    setup: Callable[[], None] | None,
) -> AbstractContextManager[Backend]:
    """The backend that a scheduler's name stands for; its processes end with the context."""
    if scheduler in ("sync", "threads") and not dashboard:
        return _in_process(workers if scheduler == "threads" else 1, setup)
    from dicflow.engine import cluster

    if scheduler in ("sync", "threads", "processes"):
        count = 1 if scheduler == "sync" else workers
        return cluster.local_cluster(count, processes=scheduler == "processes", dashboard=dashboard, setup=setup)
    return cluster.remote_cluster(scheduler, store, run_id, setup=setup)


class _InProcess:
    """Runs graphs in this process, in turn or in threads."""

    link = ""

    def __init__(self, threads: int) -> None:
        self._threads = threads

    def compute(self, graph: Mapping[GraphKey, Any], finished: Callable[[Outcome], None]) -> None:
        """Run a graph; ``finished`` is told of every task as it ends."""
        from dask.callbacks import Callback

        def told(key: GraphKey, outcome: Outcome, *_: Any) -> None:
            finished(outcome)

        with Callback(posttask=told):
            if self._threads == 1:
                from dask.local import get_sync

                get_sync(dict(graph), list(graph))
            else:
                from dask.threaded import get

                get(dict(graph), list(graph), num_workers=self._threads)


@contextmanager
def _in_process(threads: int, setup: Callable[[], None] | None) -> Iterator[Backend]:
    prepare(setup)
    yield _InProcess(threads)


def _key(job: Job) -> GraphKey:
    task = job.task
    return (task.stage, job.run_id) if task.step is None else (task.stage, task.step, job.run_id)
