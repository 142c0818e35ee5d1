"""How long tasks may take, by those that have ended."""

import pytest
from test_flow import clipped, jobs_of, popped
from toys import chain

from dicflow.engine.durations import Durations
from dicflow.engine.job_queue import JobQueue
from dicflow.engine.work import Outcome


def ended(name, seconds, status="computed"):
    stage, _, step = name.partition("/")
    return Outcome(name, stage, step or None, status, stage_s=seconds)


def test_a_step_that_took_three_times_as_long_is_expected_to_do_so_again(folder):
    tasks, durations = chain(folder).tasks, Durations()
    for name, seconds in {"read/step_01": 1.0, "read/step_02": 1.0, "read/step_03": 4.0, "scale/step_01": 0.5}.items():
        durations.add(ended(name, seconds))
    durations.add(ended("scale/step_02", 9.0, "hit"))
    assert durations.expected_s(tasks["scale/step_03"]) == pytest.approx(0.5 * 4.0 / 2.0)
    assert durations.expected_s(tasks["scale/step_05"]) == 0.5
    assert durations.expected_s(tasks["difference/step_03"]) == 0.0


def test_at_the_end_the_longest_of_equal_jobs_begins_first(folder):
    jobs, outcomes = jobs_of(clipped(folder, 1.0)), {}
    queue = JobQueue(iter(jobs), outcomes)
    reads = popped(queue)
    for name, seconds in zip(reads, [1.0, 1.0, 1.0, 1.0, 5.0, 2.0], strict=True):
        outcomes[name] = ended(name, seconds)
    for name in reads[:4]:
        queue.release(name)
    assert queue.pop()[1].task.name == "clip/step_01"
    outcomes["clip/step_01"] = ended("clip/step_01", 0.1)
    for name in ("clip/step_01", *reads[4:]):
        queue.release(name)
    assert popped(queue)[:2] == ["clip/step_05", "clip/step_06"]
