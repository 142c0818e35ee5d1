"""Workers that are jobs of a SLURM on this machine, and what is said where a cluster gives none."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from test_execute import index
from toys import chain, run_sync

from dicflow.engine.cluster_spec import ClusterSpec
from dicflow.engine.journal import runs
from dicflow.engine.schedulers import is_loopback
from dicflow.engine.store import Store
from dicflow.errors import ConfigurationError
from tests import slurm_machine
from tests.waiting import until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(slurm_machine.obstacle()), reason=slurm_machine.obstacle()),
]

OPTIONS = {
    "interface": "lo",
    "memory": "1 GB",
    "walltime": "00:10:00",
    "scheduler_options": {"host": "127.0.0.1"},
}


@pytest.fixture(scope="module")
def machine(tmp_path_factory):
    """A SLURM whose jobs find the toy stages."""
    pytest.importorskip("dask_jobqueue", reason="needs pip install 'dicflow[cluster]'")
    folder = tmp_path_factory.mktemp("slurm")
    paths = os.pathsep.join([str(Path(__file__).parent), str(Path(__file__).parents[2])])
    with slurm_machine.slurm(folder) as environment, pytest.MonkeyPatch.context() as patch:
        patch.setenv("SLURM_CONF", environment["SLURM_CONF"])
        patch.setenv("PYTHONPATH", paths)
        yield


def cluster(least=1, most=1, wait_s=120.0, **options):
    return ClusterSpec("slurm", {**OPTIONS, **options}, least, most, wait_s)


def squeue(*arguments):
    found = subprocess.run(["squeue", "-h", *arguments], capture_output=True, text=True, check=True)
    return found.stdout.split()


def no_job_left():
    """No job of a run is in the queue; SLURM lists one as completing for a while after it has been ended."""
    return squeue("-n", "dask-worker") == []


@pytest.fixture
def dasks_words():
    """A handler of what dask logs, as the console is one."""
    handler = logging.StreamHandler()
    logging.getLogger("distributed").addHandler(handler)
    yield handler
    logging.getLogger("distributed").removeHandler(handler)


def test_a_lost_job_costs_its_task_only(machine, folder, store, tmp_path, dasks_words):
    """Two jobs; one is cancelled as the first task is done. The products are those of a run here, each made once."""
    lost, seen, levels = [], [], set()

    def on_event(event):
        seen.append(event)
        levels.add(dasks_words.level)
        if event.kind == "finished" and event.stage == "scale" and not lost:
            lost.extend(squeue("-o", "%i")[:1])
            subprocess.run(["scancel", *lost], check=True)

    graph = chain(folder, sleep_s=0.5)
    result = run_sync(graph, store, cluster=cluster(2, 2), on_event=on_event)
    assert lost
    assert result.ok, result.errors
    assert result.counts["computed"] == len(graph.tasks)
    assert index(result) == index(run_sync(chain(folder), Store.open(tmp_path / "other")))
    until(no_job_left)
    jobs = runs(store)[0].folder / "jobs"
    assert jobs.stat().st_mode & 0o777 == 0o700
    assert {path.suffix for path in jobs.iterdir()} <= {".out", ".err"}, "the certificate is gone"
    assert not [event for event in seen if event.kind == "warning"], "encrypted: nothing to warn of"
    assert levels <= {logging.NOTSET, logging.CRITICAL}, "dask says again what is said here"


def test_a_run_with_nothing_to_do_starts_no_job(folder, store):
    run_sync(chain(folder), store)
    impossible = ClusterSpec("no.such.Cluster")
    assert run_sync(chain(folder), store, cluster=impossible).counts["hit"] == 24


@pytest.fixture
def full(machine, monkeypatch):
    """The machine with all of its cores taken by somebody else; a run soon says that it waits."""
    monkeypatch.setattr("dicflow.engine.job_cluster._SAY_S", 0.5)
    command = ["sbatch", "-n2", "--parsable", "-o", "/dev/null", "--wrap", "sleep 60"]
    job = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    yield
    subprocess.run(["scancel", job], check=True)


def test_a_cluster_that_gives_no_job(full, folder, store):
    said = []
    with pytest.raises(ConfigurationError, match="slurm: no job has begun within 3 s; look at the queue"):
        run_sync(chain(folder), store, cluster=cluster(wait_s=3.0), on_event=said.append)
    assert ["no job has begun yet" in event.text for event in said if event.kind == "waiting"] == [True]
    until(no_job_left)


def test_ctrl_c_while_no_job_has_begun(full, folder, store):
    def on_event(event):
        if event.kind == "waiting":
            signal.raise_signal(signal.SIGINT)

    result = run_sync(chain(folder), store, cluster=cluster(wait_s=60.0), on_event=on_event)
    assert result.interrupted
    assert result.counts["skipped"] == 24
    until(no_job_left)


def test_a_job_that_is_refused(machine, folder, store):
    with pytest.raises(ConfigurationError, match=r"slurm: the job is refused .*invalid partition"):
        run_sync(chain(folder), store, cluster=cluster(queue="nowhere"))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # dask's half-made cluster
@pytest.mark.parametrize(
    ("spec", "words"),
    [
        (ClusterSpec("slurm", {"colour": "red"}), r"slurm: .*colour.*; correct the options"),
        (ClusterSpec("distributed.NoSuch"), "distributed has no 'NoSuch'"),
        (ClusterSpec("no.such.Cluster"), "No module named 'no'; correct the name of the class"),
    ],
)
def test_a_cluster_that_cannot_be_started(machine, folder, store, spec, words):
    with pytest.raises(ConfigurationError, match=words):
        run_sync(chain(folder), store, cluster=spec)


def test_workers_without_encryption_on_another_machine_are_warned_of():
    assert not is_loopback("tcp://10.0.0.1:4000")
    with pytest.raises(ConfigurationError, match=r"--workers 3\.\.2"):
        replace(cluster(), least=3, most=2)


def test_another_class_of_dasks_kind(folder, store, monkeypatch):
    """Any cluster that dask can adapt, here processes of this machine."""
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))
    options = {"n_workers": 0, "threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}
    result = run_sync(chain(folder), store, cluster=ClusterSpec("distributed.LocalCluster", options, 1, 2))
    assert result.ok, result.errors
