"""Workers that a run starts as jobs of a cluster, scales with the work, and ends.

The scheduler lies in this process, and the jobs connect to it. Everything on the way is encrypted, and only who has the
certificate of this run gets in, unless the options say otherwise. Certificates and logs of jobs lie in the run's folder
in the store, which jobs see anyhow.
"""

from __future__ import annotations

import contextlib
import importlib
import logging
import os
import shlex
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import dask
import distributed

from dicflow.engine.cluster import checked_backend
from dicflow.engine.cluster_spec import BATCH, ClusterSpec
from dicflow.engine.schedulers import Backend, BackendOptions, scheduler_warning
from dicflow.errors import ConfigurationError

__all__ = ["started_cluster"]

_SAY_S, _LOOK_S = 30.0, 0.2
"""After so long without a worker a sentence says so; how often is looked."""
_MEMORY = "4 GB"
"""Of each worker, where neither the options nor the site's settings give the memory of a job."""
_LOOPBACK = "127.0.0.1:0"
_PEM, _ROLES = ".pem", ("client", "scheduler", "worker")


@contextmanager
def started_cluster(options: BackendOptions) -> Iterator[Backend]:
    """Workers of a cluster that is started here; its jobs end with the context.

    Raises ConfigurationError where the cluster cannot be started, refuses the jobs, gives none for long, or its workers
    have other versions, and StoreError where they do not see the store.
    """
    spec = options.cluster
    assert spec is not None
    refused, folder = list[str](), _folder(options)
    with _quiet(folder), _made(options, spec, folder, refused) as cluster:
        if warning := scheduler_warning(cluster.scheduler_address):
            options.say(f"{spec.kind}: {warning}")
        if hasattr(cluster, "adapt") and spec.kind != "ssh":  # ssh has the workers of its hosts
            cluster.adapt(minimum=spec.least, maximum=spec.most)
        with distributed.Client(cluster, set_as_default=False) as client:
            _await_worker(client, spec, refused, options)
            yield checked_backend(client, spec.kind, options, "", spec.wait_s)


def _folder(options: BackendOptions) -> Path:
    """Folder of certificates and logs of jobs, for this account alone."""
    folder = options.store.path / "runs" / options.run_id / "jobs"
    with options.store.writing():
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder


def _made(options: BackendOptions, spec: ClusterSpec, folder: Path, refused: list[str]) -> Any:
    """The cluster, without workers yet. refused : takes what the batch system says of jobs that it refuses"""
    module, _, name = spec.place.rpartition(".")
    try:
        made = getattr(importlib.import_module(module), name)
    except ImportError as error:
        raise ConfigurationError(f"{spec.kind}: {error}; {_remedy(spec)}") from error
    except AttributeError as error:
        raise ConfigurationError(f"{spec.kind}: {module} has no '{name}'; correct the name of the class") from error
    if spec.kind in BATCH:
        _check_command(spec, made.job_cls.submit_command)
    try:
        if spec.kind in BATCH:
            with options.store.writing():
                arguments = _job_options(spec, folder)
            return made(job_cls=_telling(made.job_cls, refused), **arguments)
        return made(**{"hosts": ["localhost"], **spec.options} if spec.kind == "ssh" else dict(spec.options))
    except ImportError as error:
        raise ConfigurationError(f"{spec.kind}: {error}; {_remedy(spec)}") from error
    except (TypeError, ValueError, OSError, RuntimeError) as error:
        raise ConfigurationError(f"{spec.kind}: {_first_line(error)}; correct the options of the cluster") from error


def _remedy(spec: ClusterSpec) -> str:
    """What to install where the class of a cluster, or what it needs, is missing."""
    if spec.kind in BATCH:
        return "pip install 'dicflow[cluster]'"
    return "pip install asyncssh" if spec.kind == "ssh" else "correct the name of the class, or install its package"


def _check_command(spec: ClusterSpec, submit: str) -> None:
    """Refuse a batch system whose command is missing. submit : the command that submits a job, with its options"""
    name = shlex.split(submit)[0]
    if shutil.which(name) is None:
        raise ConfigurationError(
            f"{spec.kind}: the command '{name}' is not found on this machine; start the run where you submit jobs, "
            "such as a login node of the cluster"
        )


def _job_options(spec: ClusterSpec, folder: Path) -> dict[str, Any]:
    """Arguments of a batch system's class: each task has a core and a process of its own, and nobody else gets in."""
    given = dict(spec.options)
    site = dask.config.get(f"jobqueue.{spec.kind}", {})
    cores = given.setdefault("cores", site.get("cores") or 1)
    given.setdefault("processes", site.get("processes") or cores)
    if "memory" not in given and not site.get("memory"):
        count, unit = _MEMORY.split()
        given["memory"] = f"{int(count) * cores} {unit}"
    if not {"security", "protocol"} & given.keys():
        given |= {"security": _certificate(folder), "protocol": "tls://"}
    given.setdefault("log_directory", str(folder))
    given.setdefault("silence_logs", logging.CRITICAL)  # its own default says again what is said here
    given["scheduler_options"] = {
        "dashboard": False,
        "dashboard_address": _LOOPBACK,
        **given.get("scheduler_options", {}),
    }
    pages = ["--no-dashboard", "--dashboard-address", _LOOPBACK]
    given["worker_extra_args"] = [*pages, *(given.get("worker_extra_args") or site.get("worker-extra-args") or [])]
    return given


def _certificate(folder: Path) -> distributed.Security:
    """A certificate for this run, in files that only this account can read."""
    made = distributed.Security.temporary()
    parts = {"ca": made.tls_ca_file, "cert": made.tls_worker_cert, "key": made.tls_worker_key}
    for name, text in parts.items():
        with open(os.open(folder / f"{name}{_PEM}", os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(text)
    ca, cert, key = (str(folder / f"{name}{_PEM}") for name in parts)
    pairs = {f"tls_{role}_cert": cert for role in _ROLES} | {f"tls_{role}_key": key for role in _ROLES}
    return distributed.Security(require_encryption=True, tls_ca_file=ca, **pairs)


@contextmanager
def _quiet(folder: Path) -> Iterator[None]:
    """Silence dask, which logs what is said here otherwise; at the end the run's certificate is deleted."""
    try:
        with distributed.utils.silence_logging_cmgr(logging.CRITICAL):
            logging.getLogger("tornado.application").setLevel(logging.CRITICAL)  # also for what it says at the very end
            yield
    finally:
        for path in folder.glob(f"*{_PEM}"):
            path.unlink(missing_ok=True)


def _telling(job: type[Any], refused: list[str]) -> type[Any]:
    """A class of jobs that notes why one was refused; dask itself only logs it."""

    class Telling(job):  # type: ignore[misc]
        async def start(self) -> None:
            try:
                await super().start()
            except Exception as error:
                refused.append(_reason(error))
                self.status = distributed.Status.failed  # or the cluster could not be closed
                raise

    return Telling


def _reason(error: Exception) -> str:
    """What the command that submits a job has said."""
    said = str(error).partition("stderr:\n")[2].strip() or str(error)
    return " ".join(said.split())[:300]


def _first_line(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0].rstrip(":")


def _await_worker(client: distributed.Client, spec: ClusterSpec, refused: list[str], options: BackendOptions) -> None:
    """Wait for the first worker, or until the run is stopped."""
    start, said = time.monotonic(), False
    while options.compilation.is_wanted() and not _nthreads(client):
        waited = time.monotonic() - start
        if refused:
            raise ConfigurationError(
                f"{spec.kind}: the job is refused ({refused[0]}); correct the options of the cluster"
            )
        if waited > spec.wait_s:
            raise ConfigurationError(
                f"{spec.kind}: no job has begun within {spec.wait_s:.0f} s; look at the queue and at the logs in "
                f"{_folder(options)}, ask for less, or raise 'wait' in the file of the cluster"
            )
        if waited > _SAY_S and not said:
            said = True
            options.say(f"{spec.kind}: no job has begun yet; waiting up to {spec.wait_s / 60:.0f} min, Ctrl-C gives up")
        time.sleep(_LOOK_S)


def _nthreads(client: distributed.Client) -> Mapping[str, int]:
    found: Mapping[str, int] = {}
    with contextlib.suppress(OSError):
        found = client.nthreads()
    return found
