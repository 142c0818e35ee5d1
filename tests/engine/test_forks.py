"""Workers that are forked from a process which has made the calls ahead: once for all, and never the only way."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import psutil
import pytest
from test_processes import die, process_that_meets
from waiting import PATIENCE_S, started, until

from dicflow.engine import forks
from dicflow.engine.forks import ForkedProcess, can_fork
from dicflow.engine.processes import WorkerLost, WorkerProcesses

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not can_fork(), reason="this system does not fork workers")]

COUNT = 3


def leave_number(folder: Path) -> None:
    (folder / str(os.getpid())).touch()


def is_loaded(folder: Path) -> bool:
    """Whether this process is the one that made the calls ahead."""
    return (folder / str(os.getpid())).exists()


def compute(seconds: float) -> int:
    """The process, after so much processor time."""
    start = time.process_time()
    while time.process_time() - start < seconds:
        pass
    return os.getpid()


def children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def loaders(folder: Path) -> list[psutil.Process]:
    return [psutil.Process(int(path.name)) for path in folder.iterdir()]


@pytest.fixture
def folders(tmp_path):
    found = tmp_path / "ahead", tmp_path / "meeting"
    for one in found:
        one.mkdir()
    return found


def test_what_workers_load_is_loaded_once_in_a_process_that_does_no_work(folders):
    ahead, meeting = folders
    with WorkerProcesses(2, ahead=[die_softly, partial(leave_number, ahead)]) as workers:
        workers.start()
        both = set(workers.map(process_that_meets, [meeting, meeting]))
        assert len(both) == 2
        (loader,) = loaders(ahead)
        assert {one.pid for one in loader.children()} == both
        assert not any(workers.map(is_loaded, [ahead] * COUNT))
        with pytest.raises(WorkerLost):
            workers.call(die)
        assert workers.call(pow, 2, 3) == 8
        assert len(loaders(ahead)) == 1
    assert not loader.is_running()
    assert not any(psutil.pid_exists(pid) for pid in both)


def die_softly() -> None:
    """A call ahead that goes wrong harms nothing."""
    raise OSError


def test_workers_begin_from_nothing_where_the_process_that_forks_has_died(folders):
    ahead, meeting = folders
    with WorkerProcesses(2, ahead=[partial(leave_number, ahead)]) as workers:
        first = workers.call(os.getpid)
        (loader,) = loaders(ahead)
        loader.kill()
        loader.wait(PATIENCE_S)
        workers.start()
        both = set(workers.map(process_that_meets, [meeting, meeting]))
        assert first in both
        (second,) = both - {first}
        until((ahead / str(second)).exists)  # it makes the calls by itself


def test_a_fork_that_is_not_answered_leaves_its_pipe_to_nobody(folders, monkeypatch):
    """The process that forks is given up, and a worker with a pipe of its own begins from nothing."""
    monkeypatch.setattr(forks, "_START_S", 0.0)
    ahead, _ = folders
    with WorkerProcesses(2, ahead=[partial(leave_number, ahead)]) as workers:
        first = workers.call(os.getpid)
        until((ahead / str(first)).exists)
        assert [workers.call(pow, 2, power) for power in range(20)] == [2**power for power in range(20)]


def test_processor_time_of_workers_counts_when_they_have_ended(folders):
    before = children_s()
    with WorkerProcesses(2, ahead=[partial(leave_number, folders[0])]) as workers:
        list(workers.map(compute, [0.5, 0.5]))
    assert children_s() - before >= 0.9


SCRIPT = """
import sys
from functools import partial
from pathlib import Path
sys.path[:0] = sys.argv[2:]
from dicflow.engine.processes import WorkerProcesses
from test_forks import compute, leave_number
if __name__ == "__main__":
    with WorkerProcesses(2, ahead=[partial(leave_number, Path(sys.argv[1]))]) as workers:
        workers.start()
        list(workers.map(compute, [600.0, 600.0]))
"""


def test_all_end_with_a_main_process_that_is_killed(folders, tmp_path):
    ahead, _ = folders
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    tests = Path(__file__).parent
    with started([sys.executable, script, ahead, *map(str, (tests, tests.parent, tests.parents[1]))]) as process:
        until(lambda: list(ahead.iterdir()) and len(loaders(ahead)[0].children()) == 2)
        family = psutil.Process(process.pid).children(recursive=True)
    assert psutil.wait_procs(family, timeout=PATIENCE_S)[1] == []


def test_a_forked_process_is_seen_to_end():
    with started([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        forked = ForkedProcess(child.pid)
        forked.join(0.0)
        assert forked.is_alive()
        forked.kill()
        forked.join(PATIENCE_S)
        assert not forked.is_alive()
        forked.kill()  # it is not reaped yet, and there is nothing left to kill
        child.communicate()
        forked.kill()
