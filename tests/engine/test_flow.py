"""The flow of tasks through a run: order, bounded number at once, no barrier, retries, stop, by every backend."""

import threading
import time
from pathlib import Path

import distributed
import pytest
import toys
from test_execute import clipped, index, trouble
from toys import StageSpec, chain, expand, numbers, run_sync
from waiting import PATIENCE_S

from dicflow.engine import cluster, job_queue
from dicflow.engine.fingerprint import Fingerprint
from dicflow.engine.job_queue import JobQueue
from dicflow.engine.references import Recipe, Ref
from dicflow.engine.schedulers import SCHEDULERS, scheduler_names, scheduler_warning
from dicflow.engine.share import free_threads
from dicflow.engine.store import Store
from dicflow.engine.work import Job, Outcome
from dicflow.errors import StageError

BACKENDS = {
    "sync": {"scheduler": "sync"},
    "threads": {"scheduler": "threads", "workers": 2},
    "cluster": {"scheduler": "threads", "workers": 2, "dashboard": True},
}
"""The cluster's workers are threads of this process, so that a test can hold and count its tasks."""

every_backend = pytest.mark.parametrize("options", BACKENDS.values(), ids=BACKENDS)
parallel_or_not = pytest.mark.parametrize("options", [BACKENDS["sync"], BACKENDS["threads"]], ids=["sync", "threads"])
parallel_backends = pytest.mark.parametrize(
    "options", [BACKENDS["threads"], BACKENDS["cluster"]], ids=["threads", "cluster"]
)


@pytest.fixture
def narrow(monkeypatch):
    """Few tasks at the scheduler and few that wait, so that a small run fills both."""
    monkeypatch.setattr(cluster, "_WINDOW", 4)
    monkeypatch.setattr(cluster, "_AT_A_TIME", 3)
    monkeypatch.setattr(job_queue, "_AHEAD", 4)


@pytest.fixture
def handed(monkeypatch):
    """Keyword arguments of all tasks that a client is given, with the name of the task, in order."""
    seen = []
    original = distributed.Client.submit

    def submit(self, function, job, *inputs, **options):
        seen.append({"name": job.task.name, "inputs": inputs, **options})
        return original(self, function, job, *inputs, **options)

    monkeypatch.setattr(distributed.Client, "submit", submit)
    return seen


@parallel_or_not
def test_what_is_loaded_ahead_in_this_process_ends_with_the_run(folder, store, options):
    threads = []

    def load():
        threads.append(threading.current_thread())
        time.sleep(0.5)

    assert run_sync(chain(folder), store, ahead=lambda _: [load], **options).ok
    assert not threads[0].is_alive()


@every_backend
@pytest.mark.usefixtures("narrow")
def test_a_narrow_flow_gives_the_same_products(folder, store, tmp_path, options):
    result = run_sync(chain(folder), store, **options)
    assert result.counts["computed"] == 24
    assert index(result) == index(run_sync(chain(folder), Store.open(tmp_path / "other")))


@parallel_backends
@pytest.mark.usefixtures("narrow")
def test_a_slow_task_holds_up_nothing_but_what_needs_it(folder, store, monkeypatch, options):
    """The first of 18 tasks ends only after 12 others have ended, three times as many as are at the scheduler."""
    original, others, waited = toys.Read.run, threading.Event(), []

    def run(self, source):
        if source.stem == "step_01":
            waited.append(others.wait(PATIENCE_S))
        return original(self, source)

    done = []

    def count(event):
        if event.kind == "finished":
            done.append(event.task)
            if len(done) == 12:
                others.set()

    monkeypatch.setattr(toys.Read, "run", run)
    result = run_sync(clipped(folder, 100.0), store, on_event=count, **options)
    assert result.ok
    assert waited == [True]
    assert not {"read/step_01", "clip/step_01", "scale/step_01"} & set(done[:12])


@pytest.mark.usefixtures("narrow")
def test_no_more_tasks_at_the_scheduler_than_the_window_holds(folder, store, monkeypatch):
    inside, original = [], cluster._Window._hand_over

    def hand_over(self, rank, job):
        original(self, rank, job)
        inside.append(len(self._inside))

    monkeypatch.setattr(cluster._Window, "_hand_over", hand_over)
    assert run_sync(chain(folder), store, **BACKENDS["cluster"]).ok
    assert len(inside) == 24
    assert max(inside) == 4


def test_dask_is_given_priorities_and_retries(folder, store, handed):
    graph = chain(folder)
    assert run_sync(graph, store, retries=3, **BACKENDS["cluster"]).ok
    assert len(handed) == 24
    assert {task["name"]: -task["priority"] for task in handed} == {name: k for k, name in enumerate(graph.tasks)}
    assert {task["retries"] for task in handed} == {3}


def test_only_a_chain_is_handed_over_before_its_producer_has_ended(folder, store, handed):
    run_sync(chain(folder), store, **BACKENDS["cluster"])
    futures = {
        (task["name"], one.key[:2])
        for task in handed
        for one in task["inputs"]
        if isinstance(one, distributed.Future)
    }  # fmt: skip
    chained = {(f"total/step_0{n}", ("total", f"step_0{n - 1}")) for n in range(3, 7)}
    assert futures <= chained


@every_backend
@pytest.mark.parametrize(
    ("error", "attempts"), [(ZeroDivisionError("a defect"), 3), (StageError("too large; use a smaller one"), 1)]
)
def test_two_retries_are_three_attempts_but_one_for_an_error_of_ours(
    folder, store, monkeypatch, options, error, attempts
):
    tried = []

    def run(self, number):
        if number["values"][0] < 6:
            return toys.field("number", number["values"])
        tried.append(1)
        raise error

    monkeypatch.setattr(toys.Trouble, "run", run)
    result = run_sync(trouble(folder, "defect"), store, retries=2, keep_going=True, **options)
    assert len(tried) == attempts
    (message,) = result.errors
    assert message.startswith("trouble/step_06: ")
    assert str(error) in message
    assert result.outcomes["scale/step_06"].status == "skipped"
    assert "trouble/step_06" in result.outcomes["scale/step_06"].error


@every_backend
@pytest.mark.usefixtures("narrow")
def test_a_failure_in_the_middle_leaves_no_task_without_an_outcome(folder, store, options):
    """Twelve steps, of which the third fails: tasks under way end, the others are skipped."""
    graph = trouble(numbers(folder, 12), "stage", above=2.0)
    result = run_sync(graph, store, **options)
    assert list(result.outcomes) == list(graph.tasks)
    assert result.counts["failed"] >= 1
    assert result.outcomes["scale/step_12"].status == "skipped"
    assert sum(result.counts.values()) == 36


def test_a_stopped_run_hands_over_no_further_tasks(folder, store, handed, monkeypatch):
    monkeypatch.setattr(cluster, "_WINDOW", 2)
    run_sync(trouble(numbers(folder, 12), "stage", above=2.0), store, **BACKENDS["cluster"])
    assert len(handed) < 30


@every_backend
def test_keep_going_skips_the_rest_of_a_chain_after_its_broken_step(folder, store, options):
    stages = {**chain(folder).stages, **trouble(folder, "defect", above=4.0).stages}
    stages["difference"] = StageSpec(toys.Difference(), {"before": "read", "now": "trouble"})
    graph = expand({name: stages[name] for name in ("read", "trouble", "difference", "total")})
    result = run_sync(graph, store, keep_going=True, **options)
    statuses = {step: result.outcomes[f"total/step_0{step}"].status for step in range(2, 7)}
    assert statuses == {2: "computed", 3: "computed", 4: "computed", 5: "skipped", 6: "skipped"}
    assert result.counts["failed"] == 2


def jobs_of(graph):
    return [Job("run", Path(), task, {}, {}, {}, Fingerprint("")) for task in graph.tasks.values()]


def popped(queue):
    return [job.task.name for _, job in iter(queue.pop, None)]


def test_a_queue_gives_what_can_begin_in_order(folder):
    outcomes = {}
    queue = JobQueue(iter(jobs_of(clipped(folder, 1.0))), outcomes)
    assert popped(queue) == [f"read/step_0{n}" for n in range(1, 7)]
    assert len(queue.waiting()) == 12
    for name in ("read/step_05", "read/step_02"):
        outcomes[name] = None
        queue.release(name)
    assert popped(queue) == ["clip/step_02", "clip/step_05"]


def test_near_the_end_a_queue_gives_those_with_most_behind_them(folder, monkeypatch):
    """The reading of three steps, each clipped, comes before clips whose readings have ended."""
    outcomes = {"read/step_01": None}
    jobs = [job for job in jobs_of(clipped(folder, 1.0)) if job.task.name not in outcomes]
    first = ["clip/step_01", "read/step_02"]
    monkeypatch.setattr(job_queue, "_END", 1)
    assert popped(JobQueue(iter(jobs), outcomes))[:2] == sorted(first, key=[job.task.name for job in jobs].index)
    monkeypatch.undo()
    assert popped(JobQueue(iter(jobs), outcomes)) == [*(f"read/step_0{n}" for n in range(2, 7)), "clip/step_01"]


@pytest.mark.parametrize("end", [4, 32])
def test_a_queue_prefers_jobs_whose_input_a_free_process_has_in_its_memory(folder, monkeypatch, end):
    """Of six clips that can begin: the input of the third was made in process 7, the one of the fifth is kept."""
    monkeypatch.setattr(job_queue, "_END", end)
    jobs = [job for job in jobs_of(clipped(folder, 1.0)) if job.task.stage == "clip"]
    outcomes = {}
    for n, (job, worker) in enumerate(zip(jobs, [5, 5, 7, 5, 7, 5], strict=True)):
        (name,) = job.awaited()
        ref = Ref(f"{n}", None if n == 4 else Recipe(name, job.task.node, {}, {}))
        outcomes[name] = Outcome(name, "read", None, "computed", ref, worker=worker)
    queue = JobQueue(iter(jobs), outcomes)
    assert [queue.pop(free=7)[1].task.name for _ in range(3)] == ["clip/step_03", "clip/step_01", "clip/step_02"]
    assert popped(queue) == ["clip/step_04", "clip/step_05", "clip/step_06"]


def test_a_job_knows_which_processes_have_its_inputs_in_their_memory(folder):
    """Of a step's total: its difference would be made again, and the total before it would be read."""
    job = next(job for job in jobs_of(chain(folder)) if job.task.name == "total/step_04")
    outcomes = {
        name: Outcome(
            name, "", None, "computed", Ref(name, None if kept else Recipe(name, job.task.node, {}, {})), worker=worker
        )
        for name, worker, kept in [
            ("difference/step_04", 5, False),
            ("total/step_03", 7, True),
            ("read/step_01", 0, True),
        ]
    }
    assert job.workers(outcomes) == [5]
    assert job.workers_before(outcomes) == [7]


def test_a_queue_looks_ahead_so_far(folder, monkeypatch):
    monkeypatch.setattr(job_queue, "_AHEAD", 3)
    queue = JobQueue(iter(jobs_of(clipped(folder, 1.0))), {})
    assert popped(queue) == ["read/step_01", "read/step_02"]


def test_a_queue_gives_the_next_step_of_a_chain_that_has_begun(folder):
    jobs = [job for job in jobs_of(chain(folder)) if job.task.stage == "total"]
    outcomes = {name: None for job in jobs for name in job.awaited() if not name.startswith("total")}
    begun = []
    queue = JobQueue(iter(jobs), outcomes, begun)
    assert popped(queue) == ["total/step_02"]
    begun.append("total/step_02")
    queue.release("total/step_02")
    assert popped(queue) == ["total/step_03"]


def test_every_scheduler_is_named_in_the_help():
    assert all(name in scheduler_names() for name in SCHEDULERS)
    assert [name for name in SCHEDULERS if scheduler_warning(f"{name}10.0.0.1:1" if ":" in name else name)] == [
        "tcp://"
    ]


@pytest.mark.parametrize("workers", [1, 4])
def test_a_task_uses_the_cores_that_no_other_can(folder, store, monkeypatch, workers):
    """Of six files four are read at once, by a thread each; the mean of all waits for them and has every core."""
    used = {"read": [], "rig": []}

    def counting(stage, original):
        def run(self, **inputs):
            used[stage].append(free_threads())
            return original(self, **inputs)

        return run

    monkeypatch.setattr(toys.Read, "run", counting("read", toys.Read.run))
    monkeypatch.setattr(toys.Rig, "run", counting("rig", toys.Rig.run))
    run_sync(chain(folder), store, scheduler="threads", workers=workers)
    assert used["read"][:workers] == [1] * workers
    assert used["rig"] == [workers]
    assert free_threads() == 1
