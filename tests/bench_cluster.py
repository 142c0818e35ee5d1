"""The quick start on two jobs of a SLURM on this machine, one of which is cancelled half-way.

``python -m tests.bench_cluster``, as root, with Debian's ``slurm-wlm`` and ``munge``. Compares all products with those
of a run without a cluster.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

from dicflow.engine.cluster_spec import ClusterSpec
from dicflow.engine.journal import Event
from dicflow.pipeline import Pipeline, Result
from tests import slurm_machine
from tests.bars import Figure
from tests.figures import ROOT, fresh, report

OPTIONS = {"interface": "lo", "memory": "2 GB", "walltime": "00:30:00", "scheduler_options": {"host": "127.0.0.1"}}
HALF = 40
"""Tasks after which a job is cancelled."""


def figures() -> Iterator[Figure]:
    """Products unlike those of a run without a cluster, and how many tasks were done."""
    folder = fresh("bench_cluster")
    cancelled: list[str] = []
    done: list[Event] = []

    def on_event(event: Event) -> None:
        done.extend([event] if event.kind == "finished" else [])
        if len(done) == HALF and not cancelled:
            jobs = subprocess.run(["squeue", "-h", "-t", "R", "-o", "%i"], capture_output=True, text=True).stdout
            cancelled.extend(jobs.split())
            subprocess.run(["scancel", cancelled[0]], check=True)

    def quickstart(store: str, **options: object) -> Result:
        return Pipeline.load(
            ROOT / "pipelines" / "quickstart.yaml", data=ROOT / "data_samples", store=folder / store
        ).run(**options)

    with slurm_machine.slurm(folder / "slurm") as environment:
        os.environ["SLURM_CONF"] = environment["SLURM_CONF"]
        found = quickstart("jobs", cluster=ClusterSpec("slurm", OPTIONS, 2, 2), on_event=on_event)
    expected = quickstart("here", scheduler="processes", workers=2)
    digests = [{name: ref.digest for name, ref in one.refs.items()} for one in (found, expected)]
    differing = [name for name in digests[1] if digests[0].get(name) != digests[1][name]]
    assert found.outcome is not None
    yield Figure("jobs that ran when one was cancelled", len(cancelled), 2, at_least=True)
    yield Figure("tasks computed on the cluster", found.outcome.counts["computed"], len(digests[1]), at_least=True)
    yield Figure("products unlike those of a run without a cluster", len(differing), 0)


if __name__ == "__main__":
    sys.exit(slurm_machine.obstacle() or report(figures()))
