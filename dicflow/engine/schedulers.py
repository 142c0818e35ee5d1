"""The schedulers that a run can use, by name or by address scheme.

A scheduler is one entry of :data:`SCHEDULERS`, or an entry point ``dicflow.schedulers`` of another package that names a
function like ``Scheduler.open``. The name of the entry point serves alone and as the scheme of an address. Nothing of
dask and no plug-in is imported before a scheduler is opened.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol
from urllib.parse import urlsplit

from dicflow.discovery import Registry, nearest
from dicflow.engine.cluster_spec import ClusterSpec
from dicflow.engine.compilation import Compilation
from dicflow.errors import ConfigurationError

if TYPE_CHECKING:
    from dicflow.engine.processes import WorkerProcesses
    from dicflow.engine.store import Store
    from dicflow.engine.work import Job, Outcome

__all__ = [
    "SCHEDULERS",
    "Backend",
    "BackendOptions",
    "Scheduler",
    "check_scheduler",
    "is_loopback",
    "open_backend",
    "scheduler_names",
    "scheduler_warning",
]

_UNENCRYPTED = "tcp:// to another machine is neither encrypted nor authenticated, and runs what it is sent; use tls://"


class Backend(Protocol):
    """Something that runs jobs. link : address of the dashboard, "" without one"""

    link: str

    def compute(
        self, jobs: Iterator[Job], outcomes: Mapping[str, Outcome], finished: Callable[[Outcome], None]
    ) -> None:
        """Run jobs, a bounded number at once, and take the next one when one ends.

        jobs : every job after those it takes from; it ends early when the run is stopped
        outcomes : of all tasks that have ended; ``finished`` adds to it
        finished : called once per job, in the thread that called this

        A job is run by :func:`dicflow.engine.work.perform`. Where that raises a Defect it is tried again, as often as
        ``BackendOptions.retries`` says, and the last Defect's text is the error of a failed outcome.

        Raises WorkerError where no worker is left to run them.
        """


@dataclass(frozen=True)
class BackendOptions:
    """What a scheduler is opened with.

    scheduler : its name or address
    workers : tasks at once; an address has its own number of workers
    retries : how often a task that raised an error other than a DicflowError is tried again
    setup : called once in every worker
    processes : worker processes of the caller, which outlive the backend; None to start own ones
    ahead : what workers do while they wait for work
    compilation : a scheduler may ignore it; then each worker compiles what it uses
    cluster : whose workers are started in the place of those of ``scheduler``
    say : called with sentences for the user, about what is waited for
    """

    scheduler: str
    store: Store
    run_id: str
    workers: int = 1
    dashboard: bool = False
    retries: int = 0
    setup: Callable[[], None] | None = None
    processes: WorkerProcesses | None = None
    compilation: Compilation = field(default_factory=Compilation)
    ahead: Sequence[Callable[[], None]] = ()
    cluster: ClusterSpec | None = None
    say: Callable[[str], None] = print


@dataclass(frozen=True)
class Scheduler:
    """One way to run jobs.

    open : gives the backend; its processes end with the context
    warning : text about a name or address that can be used at a risk, "" for none
    """

    open: Callable[[BackendOptions], AbstractContextManager[Backend]]
    warning: Callable[[str], str] = lambda _: ""


def is_loopback(address: str) -> bool:
    """Whether a scheduler's address can be reached from this machine only."""
    return urlsplit(address).hostname in ("localhost", "127.0.0.1", "::1")


def _processes(options: BackendOptions) -> AbstractContextManager[Backend]:
    if options.dashboard:
        from dicflow.engine.dashboard import dashboard_cluster

        return dashboard_cluster(options, processes=True)
    from dicflow.engine.local import in_processes

    return in_processes(options)


def _threads(options: BackendOptions) -> AbstractContextManager[Backend]:
    if options.dashboard:
        from dicflow.engine.dashboard import dashboard_cluster

        return dashboard_cluster(options, processes=False)
    from dicflow.engine.local import in_process

    return in_process(options)


def _sync(options: BackendOptions) -> AbstractContextManager[Backend]:
    return _threads(replace(options, workers=1))


def _address(options: BackendOptions) -> AbstractContextManager[Backend]:
    from dicflow.engine.cluster import remote_cluster

    return remote_cluster(options)


def _exposed(address: str) -> str:
    return "" if is_loopback(address) else f"{address}: {_UNENCRYPTED}"


def _auto(options: BackendOptions) -> AbstractContextManager[Backend]:
    return (_threads if options.processes is None and not options.dashboard else _processes)(options)


SCHEDULERS: Mapping[str, Scheduler] = {
    "auto": Scheduler(_auto),
    "processes": Scheduler(_processes),
    "threads": Scheduler(_threads),
    "sync": Scheduler(_sync),
    "tcp://": Scheduler(_address, _exposed),
    "tls://": Scheduler(_address),
}
"""Name, or scheme of an address that ends in ``://`` → scheduler."""

_PLUGINS = Registry("scheduler", "", "dicflow.schedulers")


def scheduler_names() -> str:
    """The names and forms of address of our own schedulers in one line, for help and messages."""
    *names, last = (f"{name}host:port" if name.endswith("://") else name for name in SCHEDULERS)
    return f"{', '.join(names)} or {last}"


def check_scheduler(scheduler: str, workers: int) -> None:
    """Raises ConfigurationError for an unknown scheduler, an address without host or port, and less than one worker."""
    if _entry(scheduler) not in SCHEDULERS and _plugin(scheduler) not in _PLUGINS.names():
        hint = nearest(scheduler, [*SCHEDULERS, *_PLUGINS.names()])
        known = ", ".join([scheduler_names(), *_PLUGINS.names()])
        raise ConfigurationError(f"unknown scheduler '{scheduler}'{hint}; use {known}")
    if _entry(scheduler) in ("tcp://", "tls://"):
        _check_address(scheduler)
    if workers < 1:
        raise ConfigurationError(f"workers must be at least 1, got {workers}")


def _check_address(address: str) -> None:
    try:
        parts = urlsplit(address)
        whole = bool(parts.hostname and parts.port) and not (parts.path or parts.query or parts.fragment)
    except ValueError:
        whole = False
    if not whole:
        example = f"{_entry(address)}127.0.0.1:8786"
        raise ConfigurationError(f"--scheduler {address}: not an address; write host and port, such as {example}")


def scheduler_warning(scheduler: str) -> str:
    """Text about a risk of a scheduler, "" for none."""
    entry = SCHEDULERS.get(_entry(scheduler))
    return entry.warning(scheduler) if entry is not None else ""


def open_backend(options: BackendOptions) -> AbstractContextManager[Backend]:
    """The backend of a scheduler; its processes end with the context.

    Raises ConfigurationError for a plug-in that cannot be imported, and for a name that two packages use.
    """
    if options.cluster is not None:
        from dicflow.engine.job_cluster import started_cluster

        return started_cluster(options)
    entry = SCHEDULERS.get(_entry(options.scheduler))
    if entry is None:
        entry = Scheduler(_PLUGINS.load(_plugin(options.scheduler)))
    return entry.open(options)


def _entry(scheduler: str) -> str:
    """Name of its entry in our own table."""
    scheme, separator, _ = scheduler.partition("://")
    return scheme + separator


def _plugin(scheduler: str) -> str:
    """Name of its entry point: the name itself, or the scheme of an address."""
    return scheduler.partition("://")[0]
