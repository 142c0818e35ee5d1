"""Worker processes: what they answer, and that one that dies or does not start never holds up the others."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from functools import partial
from pathlib import Path

import psutil
import pytest
import toys
from test_execute import trouble
from toys import chain, numbers, run_sync
from waiting import PATIENCE_S, started, until

from dicflow.engine import processes
from dicflow.engine.processes import WorkerLost, WorkerProcesses, survive
from dicflow.errors import InputError, WorkerError

pytestmark = pytest.mark.slow


class Odd(Exception):
    """An error that cannot be made again from its arguments."""

    def __init__(self, one, two):
        super().__init__(f"{one} {two}")


def raise_odd():
    raise Odd("a", "b")


def raise_input_error():
    raise InputError("photo.png: is empty")


def process_that_meets(others: Path) -> int:
    """The process, once two have come to a folder: so both are at work at once."""
    (others / str(os.getpid())).touch()
    until(lambda: len(list(others.iterdir())) == 2)
    return os.getpid()


def die(mark=None):
    """Die by SIGKILL; with a file, only until it exists."""
    if mark is None or not mark.exists():
        if mark is not None:
            mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def stop_unless_first(folder):
    """The first worker starts; every later one stops while it starts, and leaves its number."""
    try:
        (folder / "first").open("x").close()
    except FileExistsError:
        (folder / str(os.getpid())).touch()
        os.kill(os.getpid(), signal.SIGSTOP)


def replacements(folder):
    return [psutil.Process(int(path.name)) for path in folder.iterdir() if path.name.isdecimal()]


@pytest.fixture
def starts(tmp_path):
    """A folder in which replacements leave their numbers."""
    (tmp_path / "starts").mkdir()
    return tmp_path / "starts"


def test_calls_run_elsewhere_and_bring_values_and_errors_back():
    with WorkerProcesses(2) as workers:
        assert workers.call(pow, 2, 10) == 1024
        assert workers.call(os.getpid) != os.getpid()
        assert list(workers.map(abs, [-3, 2, -1])) == [3, 2, 1]
        with pytest.raises(InputError, match=r"photo\.png: is empty"):
            workers.call(raise_input_error)
        with pytest.raises(RuntimeError, match="Odd: a b"):
            workers.call(raise_odd)
        with pytest.raises(AttributeError):
            workers.call(partial(raise_odd, lambda: None))  # this cannot be sent
        assert workers.call(pow, 2, 3) == 8


def test_a_preferred_worker_is_taken_if_it_is_free(tmp_path):
    with WorkerProcesses(2) as workers:
        workers.start()
        both = set(workers.map(process_that_meets, [tmp_path, tmp_path]))
        first, second = sorted(both)
        assert [workers.call(os.getpid, preferred=[second]) for _ in range(3)] == [second] * 3
        assert [workers.call(os.getpid, preferred=[first]) for _ in range(3)] == [first] * 3
        assert {workers.call(os.getpid) for _ in range(2)} == both, "the one that has waited longest comes first"
        assert [workers.call(os.getpid, preferred=[-1, one, second]) for one in (first, second)] == [first, second]
        assert workers.call(os.getpid, preferred=[-1]) in both


def test_workers_end_with_the_context_and_start_when_they_are_needed(ours):
    with WorkerProcesses(5) as workers:
        assert len({workers.call(os.getpid) for _ in range(3)}) == 1
        (worker,) = [one for one in ours()[1:] if "resource_tracker" not in " ".join(one.cmdline())]
    assert not worker.is_running()


def test_a_worker_that_dies_is_replaced(tmp_path):
    with WorkerProcesses(1) as workers:
        first = workers.call(os.getpid)
        with pytest.raises(WorkerLost):
            workers.call(die)
        assert workers.call(os.getpid) != first
        assert survive(1, workers.call, die, tmp_path / "mark") > 0
        with pytest.raises(WorkerError, match="killed twice"):
            list(workers.map(die, [None]))


def test_a_worker_that_dies_while_it_is_idle_costs_no_call():
    with WorkerProcesses(1) as workers:
        workers.call(os.getpid)
        (worker,) = workers._workers
        worker.process.kill()
        worker.process.join()
        assert workers.call(pow, 2, 3) == 8


def test_a_replacement_that_never_starts_ends_in_one_sentence(starts, monkeypatch):
    monkeypatch.setattr(processes, "_START_S", 0.3)
    with WorkerProcesses(1, partial(stop_unless_first, starts)) as workers:
        monkeypatch.setattr(processes, "_START_S", PATIENCE_S)
        assert workers.call(pow, 2, 3) == 8
        monkeypatch.setattr(processes, "_START_S", 0.3)
        with pytest.raises(WorkerError, match="no worker process starts, tried 2 times"):
            survive(1, workers.call, die)
        with pytest.raises(WorkerError):
            workers.call(pow, 2, 3)


def test_a_place_that_was_never_needed_takes_over(tmp_path, monkeypatch):
    """Of two places one has had a worker; its replacement does not get ready, and the second place is the last hope."""
    original, asked = processes._Worker.is_ready, []

    def is_ready(self):
        asked.append(self)
        return len(asked) != 2 and original(self)

    monkeypatch.setattr(processes, "_STARTS", 1)
    monkeypatch.setattr(processes._Worker, "is_ready", is_ready)
    with WorkerProcesses(2) as workers:
        assert workers.call(pow, 2, 3) == 8
        assert survive(1, workers.call, die, tmp_path / "mark") > 0
    assert len(asked) == 3


def test_a_setup_that_cannot_be_sent_is_an_error_and_no_wait():
    with (
        WorkerProcesses(2, lambda: None) as workers,
        pytest.raises(WorkerError, match=r"no worker process starts.*lambda"),
    ):
        workers.call(pow, 2, 3)


UNGUARDED = """
import sys
from pathlib import Path
sys.path[:0] = sys.argv[3:]
from dicflow.engine.store import Store
from toys import chain, numbers, run_sync
result = run_sync(chain(Path(sys.argv[1])), Store.open(Path(sys.argv[2])), scheduler="processes")
print(result.errors)
"""


def test_a_script_that_runs_again_in_its_workers_is_told_so(folder, store, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(UNGUARDED)
    command = [sys.executable, script, folder, store.path, str(Path(__file__).parent)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert "read/step_01: no worker process starts" in done.stdout
    assert "worker processes import the script again; put what it does below a line" in done.stderr


def test_a_replacement_that_starts_slowly_is_waited_for(starts):
    def continue_it():
        until(lambda: [one for one in replacements(starts) if one.status() == psutil.STATUS_STOPPED])[0].resume()

    with WorkerProcesses(1, partial(stop_unless_first, starts)) as workers:
        assert workers.call(pow, 2, 3) == 8
        helper = threading.Thread(target=continue_it)
        helper.start()
        with pytest.raises(WorkerLost):
            workers.call(die)
        assert workers.call(pow, 2, 3) == 8
        helper.join()


def test_the_other_worker_goes_on_while_a_replacement_is_stopped(folder, store, starts):
    """One worker of two dies at the fourth number, and its replacement never gets ready."""
    setup = partial(stop_all_but, 2, starts)
    options = {"scheduler": "processes", "workers": 2, "keep_going": True}
    result = run_sync(trouble(folder, "kill once", above=5.0), store, worker_setup=setup, **options)
    assert result.ok, result.errors
    assert not any(psutil.pid_exists(int(path.name)) for path in starts.iterdir() if path.name.isdecimal())


def stop_all_but(count, folder):
    """As :func:`stop_unless_first`, for the first ``count`` workers."""
    for number in range(count):
        try:
            (folder / f"first {number}").open("x").close()
        except FileExistsError:
            continue
        return
    (folder / str(os.getpid())).touch()
    os.kill(os.getpid(), signal.SIGSTOP)


def test_a_run_without_workers_fails_with_one_error_and_names_what_to_do(folder, store, starts, monkeypatch):
    monkeypatch.setattr(processes, "_START_S", 0.0)
    result = run_sync(chain(folder), store, scheduler="processes", workers=2)
    assert result.counts == {"hit": 0, "computed": 0, "failed": 1, "skipped": 23}
    (error,) = result.errors
    assert (
        error == "read/step_01: no worker process starts, tried 2 times; 'dicflow run --scheduler threads' needs none"
    )
    monkeypatch.undo()
    assert run_sync(chain(folder), store, scheduler="processes").ok


RUN = """
import signal, sys
from pathlib import Path
sys.path[:0] = sys.argv[3:]
from dicflow.cli import _end_in_order
from dicflow.engine.store import Store
from toys import chain, numbers, run_sync
if __name__ == "__main__":
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # whoever started the tests may ignore it
    _end_in_order()
    graph = chain(Path(sys.argv[1]), sleep_s=600.0)
    store = Store.open(Path(sys.argv[2]))
    run_sync(graph, store, scheduler="processes", on_event=lambda event: print(event.stage, flush=True))
"""


@pytest.mark.parametrize("are_ready", [False, True])
def test_quick_tasks_are_done_here_as_long_as_no_worker_is_ready(folder, store, monkeypatch, are_ready):
    here, read, scaled = [], toys.Read.run, toys.Scale.run
    monkeypatch.setattr(toys.Read, "is_quick", True)
    monkeypatch.setattr(toys.Read, "run", lambda node, **given: here.append("read") or read(node, **given))
    monkeypatch.setattr(toys.Scale, "run", lambda node, **given: here.append("scale") or scaled(node, **given))
    monkeypatch.setattr(WorkerProcesses, "are_ready", are_ready)
    result = run_sync(chain(folder), store, scheduler="processes", workers=2)
    assert result.ok
    assert set(here) == (set() if are_ready else {"read"})


def semaphores(processes):
    """Files of the named semaphores that processes use, where the system shows them."""
    maps = (Path(f"/proc/{one.pid}/maps") for one in processes)
    lines = [line for path in maps if path.exists() for line in path.read_text().splitlines()]
    return {Path(line.split()[-1]) for line in lines if "/dev/shm/sem." in line and not line.endswith("(deleted)")}


@pytest.mark.parametrize(("number", "code"), [("SIGTERM", 143), ("SIGHUP", 129), ("SIGKILL", -9)])
@pytest.mark.parametrize("group", [False, True], ids=["alone", "group"])
def test_a_signal_ends_the_workers_too_and_leaves_nothing(folder, store, tmp_path, number, code, group):
    """While both workers are in a task of ten minutes."""
    script = tmp_path / "script.py"
    script.write_text(RUN)
    command = [sys.executable, script, folder, store.path, str(Path(__file__).parent)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with started(command, start_new_session=True, **pipes) as process:
        next(line for line in iter(process.stdout.readline, "") if line == "rig\n")
        workers = psutil.Process(process.pid).children()
        named = semaphores([process, *workers])
        (os.killpg if group else os.kill)(process.pid, getattr(signal, number))
        _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == code
    assert errors == ""
    assert psutil.wait_procs(workers, timeout=PATIENCE_S)[1] == []
    assert not any(path.exists() for path in named)


@pytest.mark.parametrize(("scheduler", "count", "tasks"), [("auto", 2, 8), ("auto", 3, 12), ("processes", 2, 8)])
def test_few_tasks_start_no_workers(scheduler, count, tasks, tmp_path, store, monkeypatch):
    entered = []
    monkeypatch.setattr(WorkerProcesses, "start", lambda self: entered.append(self.count))
    graph = chain(numbers(tmp_path / "numbers", count))
    assert len(graph.tasks) == tasks
    assert run_sync(graph, store, scheduler=scheduler, workers=2).ok
    assert entered == ([] if scheduler == "auto" and tasks < 9 else [2])
