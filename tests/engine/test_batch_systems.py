"""What is handed to PBS, LSF and SGE, whose commands are stood in for by scripts here: no job of theirs is tried."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from test_execute import index
from toys import chain, run_sync

from dicflow.engine.cluster_spec import ClusterSpec
from dicflow.engine.store import Store
from dicflow.errors import ConfigurationError, StoreError

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash"),
]

SUBMIT = """#!/bin/bash
cp "${{1:-/dev/stdin}}" {folder}/script
echo "$0 $@" >> {folder}/calls
{job}
echo '{answer}'
"""
CANCEL = """#!/bin/bash
echo "$0 $@" >> {folder}/calls
[ ! -e {folder}/job ] || kill -- -$(cat {folder}/job)
"""
JOB = "setsid bash {folder}/script > {folder}/log 2>&1 & echo $! > {folder}/job"
SYSTEMS = {
    "pbs": ("qsub", "4711.server", "qdel"),
    "lsf": ("bsub", "Job <4711> is submitted to queue <normal>.", "bkill"),
    "sge": ("qsub", 'Your job 4711 ("dicflow") has been submitted', "qdel"),
}
OPTIONS = {"queue": "short", "cores": 2, "memory": "8 GB", "scheduler_options": {"host": "127.0.0.1"}}
TIMES = {"pbs": "04:00:00", "lsf": "04:00", "sge": "04:00:00"}
HEADERS = {
    "pbs": ["#PBS -q short", "#PBS -l select=1:ncpus=2:mem=7630MB", "#PBS -l walltime=04:00:00"],
    "lsf": ["#BSUB -q short", "#BSUB -n 2", '#BSUB -R "span[hosts=1]"', "#BSUB -W 04:00", "#BSUB -M 8000000"],
    "sge": ["#$ -q short", "#$ -l h_rt=04:00:00"],
}


@pytest.fixture
def system(tmp_path, monkeypatch):
    """Stands in for the commands of a batch system; gives the folder with what they got."""
    pytest.importorskip("dask_jobqueue", reason="needs pip install 'dicflow[cluster]'")
    folder = tmp_path / "system"
    folder.mkdir()

    def stand_in(kind, job=""):
        submit, answer, cancel = SYSTEMS[kind]
        for name, text in ((submit, SUBMIT), (cancel, CANCEL)):
            (folder / name).write_text(text.format(folder=folder, answer=answer, job=job.format(folder=folder)))
            (folder / name).chmod(0o700)
        return folder

    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(__file__).parent), str(Path(__file__).parents[2])]))
    return stand_in


def cluster(kind, wait_s=120.0, most=1, **options):
    return ClusterSpec(kind, {**OPTIONS, "walltime": TIMES[kind], **options}, 1, most, wait_s)


@pytest.mark.parametrize("kind", SYSTEMS)
def test_the_job_that_is_submitted_and_withdrawn(system, folder, store, kind):
    place = system(kind)
    submit, _, cancel = SYSTEMS[kind]
    prologue = ["module load python/3.11"]
    with pytest.raises(ConfigurationError, match=f"{kind}: no job has begun within 1 s"):
        run_sync(chain(folder), store, cluster=cluster(kind, wait_s=1.0, job_script_prologue=prologue))
    lines = (place / "script").read_text().splitlines()
    assert set(HEADERS[kind]) <= set(lines)
    command = next(line for line in lines if "distributed.cli.dask_worker" in line)
    assert lines.index(prologue[0]) < lines.index(command)
    assert "tls://127.0.0.1:" in command
    for words in ("--nworkers 2", "--nthreads 1", "--no-dashboard", "--tls-key", "--memory-limit 3.73GiB"):
        assert words in command
    assert str(store.path / "runs") in command, "certificates and logs lie in the store, which jobs see"
    first, *_, last = (place / "calls").read_text().splitlines()
    assert first.startswith(str(place / submit))
    assert last == f"{place / cancel} 4711"


def test_a_job_that_such_a_system_runs(system, folder, store, tmp_path):
    """LSF's way, in which the script comes through a pipe."""
    place = system("lsf", JOB)
    patient = cluster("lsf", wait_s=600.0, cores=1, death_timeout=600)
    result = run_sync(chain(folder), store, cluster=patient)
    assert result.ok, result.errors
    assert index(result) == index(run_sync(chain(folder), Store.open(tmp_path / "other")))
    assert (place / "calls").read_text().splitlines()[-1].endswith("bkill 4711")


def test_a_full_disk_while_the_certificate_is_written(system, folder, store, monkeypatch):
    system("pbs")

    def full(folder):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("dicflow.engine.job_cluster._certificate", full)
    with pytest.raises(StoreError, match="the disk is full; free some space"):
        run_sync(chain(folder), store, cluster=cluster("pbs"))


def test_a_batch_system_whose_command_is_not_here(folder, store, monkeypatch):
    pytest.importorskip("dask_jobqueue", reason="needs pip install 'dicflow[cluster]'")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(ConfigurationError, match=r"pbs: the command 'qsub' is not found .* login node"):
        run_sync(chain(folder), store, cluster=ClusterSpec("pbs"))
