"""The table of where the time of a run goes adds up to what the system counts."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

from dicflow.engine.work import Outcome
from dicflow.pipeline import profile
from dicflow.pipeline.profile import Share, shares


def outcome(name, cpu_s, stage_cpu_s, status="computed"):
    return Outcome(name, name.partition("/")[0], None, status, cpu_s=cpu_s, stage_cpu_s=stage_cpu_s)


def test_parts_of_the_tasks_add_up(monkeypatch):
    """Of 9.5 s in workers and 1 s here 4 s were compiling and 4.5 s in stages; the rest is the engine's."""
    monkeypatch.setattr(profile, "children_cpu_s", lambda: 12.0)
    done = [outcome("a/1", 2.0, 1.5), outcome("a/2", 1.0, 1.0), outcome("b", 2.25, 2.0), outcome("c", 0.0, 0.0, "hit")]
    run = SimpleNamespace(compiled_s={"a": 4.0}, outcomes={one.name: one for one in done})
    spent = {"start": profile.Spent(1.0, 0.5, 0.0), "tasks": profile.Spent(6.0, 1.0, 9.5)}
    found = shares(SimpleNamespace(spent=spent), run)
    assert found == [
        Share("start", None, 1.0, 0.5),
        Share("tasks", None, 6.0, 0.0),
        Share("  compiling", None, None, 4.0),
        Share("  a", 2, None, 2.5),
        Share("  b", 1, None, 2.0),
        Share("  engine", None, None, 1.0 + 9.5 - 4.0 - 4.5),
        Share("workers: start and end", None, None, 2.5),
    ]
    assert sum(share.cpu_s for share in found) == 0.5 + 1.0 + 12.0


@pytest.mark.slow
@pytest.mark.parametrize("scheduler", ["processes", "sync"])
def test_the_table_agrees_with_the_system(pipeline, tmp_path, scheduler):
    """Wall and processor time of the whole process, but for the ends of interpreters."""
    places = ["--store", tmp_path / "store", "--output", tmp_path / "results"]
    command = [sys.executable, "-m", "dicflow", "run", pipeline, *places, "--profile", "--json", "--workers", "2"]
    out, err = tmp_path / "out", tmp_path / "err"
    with out.open("w") as output, err.open("w") as errors:
        started = time.time()
        process = subprocess.Popen([*command, "--scheduler", scheduler], stdout=output, stderr=errors)
        _, status, used = os.wait4(process.pid, 0)  # of this process and those that it has started
    wall_s = out.stat().st_mtime - started  # until its last words
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0, err.read_text()
    cpu_s = used.ru_utime + used.ru_stime
    said = json.loads(out.read_text().splitlines()[-1])
    found = said["profile"]
    assert found["cpu_s"] == pytest.approx(cpu_s, rel=0.05, abs=0.2)
    assert 0.8 * wall_s <= found["wall_s"] <= wall_s + 0.02
    assert found["cpu_s"] == pytest.approx(sum(part["cpu_s"] for part in found["parts"]), abs=0.01)
    assert sum(part["tasks"] or 0 for part in found["parts"]) == said["counts"]["computed"]
    assert "where the time goes" in err.read_text()
