import json
import os
import shutil
import signal
import threading

import numpy as np
import pytest
import toys
from toys import StageSpec, chain, expand, run_sync, write

from dicflow.engine.execute import Options, dask_graph, run
from dicflow.engine.journal import find_run
from dicflow.engine.plan import make_plan
from dicflow.engine.references import cache
from dicflow.engine.store import Store
from dicflow.engine.verification import verify
from dicflow.errors import ConfigurationError, StageError


def computed(result):
    """Stages that were computed, with how often."""
    return {stage: int(row["computed"]) for stage, row in result.by_stage().items() if row["computed"]}


def states(store):
    """Inode and time of every file among the objects."""
    paths = (path for path in (store.path / "objects").rglob("*") if path.is_file())
    return {path: (path.stat().st_ino, path.stat().st_mtime_ns) for path in paths}


def index(result):
    return {name: outcome.ref.digest for name, outcome in result.outcomes.items()}


def test_a_run_gives_the_products(folder, store):
    result = run_sync(chain(folder), store)
    assert result.ok
    assert result.counts == {"hit": 0, "computed": 24, "failed": 0, "skipped": 0}
    np.testing.assert_array_equal(result.product("scale/step_03")["values"], 6.0)
    np.testing.assert_array_equal(result.product("total/step_06")["values"], 10.0)
    assert result.product("report").attrs == {"last": 10.0, "steps": [f"step_0{n}" for n in range(2, 7)]}
    assert result.product("rig").attrs["mean"] == 3.5


def test_there_and_back_again_computes_nothing(folder, store):
    first = run_sync(chain(folder), store)
    run_sync(chain(folder, factor=3.0), store)
    back = run_sync(chain(folder), store)
    assert back.counts["hit"] == 24
    assert index(back) == index(first)


def test_a_changed_parameter_computes_its_stage_and_what_follows(folder, store):
    run_sync(chain(folder, keep="always"), store)
    before = states(store)
    result = run_sync(chain(folder, keep="always", factor=3.0), store)
    assert computed(result) == {"scale": 6, "difference": 5, "total": 5, "report": 1}
    assert result.counts["hit"] == 7
    after = states(store)
    assert {path: after[path] for path in before} == before


def clipped(folder, limit):
    stages = chain(folder).stages
    return expand(
        {
            "read": stages["read"],
            "clip": StageSpec(toys.Clip(limit=limit), {"number": "read"}),
            "scale": StageSpec(toys.Scale(), {"number": "clip"}),
        }
    )


def test_the_same_output_stops_the_recomputation(folder, store):
    run_sync(clipped(folder, 5.5), store)
    result = run_sync(clipped(folder, 5.25), store)
    assert computed(result) == {"clip": 6, "scale": 1}
    assert result.outcomes["scale/step_01"].status == "hit"


def test_rewriting_a_file_with_the_same_meaning_stops_after_reading(folder, store):
    run_sync(chain(folder), store)
    write(folder / "step_02.txt", "2.0 and a comment")
    assert computed(run_sync(chain(folder), store)) == {"read": 1}


def test_one_changed_number_computes_its_step_only(folder, store):
    run_sync(clipped(folder, 100.0), store)
    write(folder / "step_02.txt", "2.5")
    assert computed(run_sync(clipped(folder, 100.0), store)) == {"read": 1, "clip": 1, "scale": 1}


def test_an_explicit_default_is_no_change(folder, store):
    run_sync(chain(folder), store)
    assert run_sync(chain(folder, factor=2.0, length="2 cm", threads=9), store).counts["hit"] == 24


def test_another_folder_gives_the_same_keys(folder, store, tmp_path):
    run_sync(chain(folder), store)
    shutil.copytree(folder, tmp_path / "moved" / "far")
    assert run_sync(chain(tmp_path / "moved" / "far"), store).counts["hit"] == 24


def test_threads_give_the_same_keys_and_products(folder, store, tmp_path):
    one = run_sync(chain(folder), store)
    other = run_sync(chain(folder), Store.open(tmp_path / "other"), scheduler="threads", workers=3)
    assert index(one) == index(other)
    assert {o.key for o in one.outcomes.values()} == {o.key for o in other.outcomes.values()}


def test_products_that_are_not_kept_are_made_again(folder, store, monkeypatch):
    result = run_sync(chain(folder, keep="never"), store)
    assert not store.manifest(index(result)["scale/step_03"]).kept
    assert store.manifest(index(result)["total/step_03"]).kept
    made = []
    monkeypatch.setattr(toys.Scale, "run", lambda self, **_: made.append(1) or toys.field("number", [6.0] * 10))
    cache.clear()
    again = run_sync(chain(folder, keep="never"), store, code_policy="ignore")
    assert (again.counts["hit"], made) == (24, [])
    with pytest.raises(StageError, match=r"scale/step_03: .*keep: always"):
        again.product("scale/step_03")["values"]
    assert made == [1]


def test_keeping_or_not_gives_the_same_digests(folder, store, tmp_path):
    kept = run_sync(chain(folder, keep="always"), store)
    other = Store.open(tmp_path / "other")
    remade = run_sync(chain(folder, keep="never"), other)
    assert index(kept) == index(remade)
    assert sum(other.manifest(digest).kept for digest in index(remade).values()) < len(remade.outcomes)
    np.testing.assert_array_equal(remade.product("difference/step_04")["values"], 2.0)


def test_deleted_and_cut_objects_are_made_again(folder, store):
    first = run_sync(chain(folder, keep="always"), store)
    shutil.rmtree(store.object_path(index(first)["scale/step_02"]))
    chunk = store.object_path(index(first)["total/step_03"]) / "values" / "c.0"
    chunk.write_bytes(chunk.read_bytes()[:-3])
    result = run_sync(chain(folder, keep="always"), store)
    assert computed(result) == {"scale": 1, "total": 1}
    assert index(result) == index(first)


def test_damage_that_only_reading_shows_is_repaired_in_the_same_run(folder, store):
    first = run_sync(chain(folder, keep="always"), store)
    chunk = store.object_path(index(first)["scale/step_02"]) / "values" / "c.0"
    content = bytearray(chunk.read_bytes())
    content[-6] ^= 8
    chunk.write_bytes(content)
    for name in ("difference/step_02", "difference/step_03"):
        store.record_path(first.outcomes[name].key).unlink()
    cache.clear()
    result = run_sync(chain(folder, keep="always"), store)
    assert result.ok
    assert index(result) == index(first)
    assert len(list((store.path / "quarantine").iterdir())) == 2


def test_many_damaged_products_are_made_again_in_one_run(folder, store):
    """As after a power failure; a task finds one at a time."""
    made = run_sync(chain(folder, keep="always"), store)
    numbers = [outcome for name, outcome in made.outcomes.items() if outcome.stage == "read"]
    for outcome in numbers:
        chunk = store.object_path(outcome.ref.digest) / "values" / "c.0"
        chunk.write_bytes(bytes(chunk.stat().st_size))
    store.record_path(made.outcomes["rig"].key).unlink()
    cache.clear()
    again = run_sync(chain(folder, keep="always"), store)
    assert (again.ok, again.counts["computed"]) == (True, len(numbers) + 1)
    assert index(again) == index(made)
    assert verify(store) == []


def trouble(folder, how, above=5.0, **parameters):
    """Trouble at step_06, the only one with a number above 5."""
    return expand(
        {
            "read": StageSpec(toys.Read(), {}, folder),
            "trouble": StageSpec(
                toys.Trouble(how=how, above=above, marks=str(folder), **parameters), {"number": "read"}
            ),
            "scale": StageSpec(toys.Scale(), {"number": "trouble"}),
        }
    )


def test_a_failure_stops_the_run_and_names_stage_and_step(folder, store):
    result = run_sync(trouble(folder, "stage"), store)
    assert not result.ok
    assert result.errors == ["trouble/step_06: the number is too large; use a smaller one"]
    assert result.counts["skipped"] > 0
    with pytest.raises(StageError, match=r"scale/step_06: has no product, it skipped"):
        result.product("scale/step_06")


def test_keep_going_fails_descendants_only(folder, store):
    result = run_sync(trouble(folder, "stage", above=2.0), store, keep_going=True)
    assert result.counts == {"hit": 0, "computed": 6 + 2 + 2, "failed": 4, "skipped": 4}
    assert result.outcomes["scale/step_05"].error == "trouble/step_05 failed"


def test_a_corrected_run_goes_on_where_it_stopped(folder, store):
    run_sync(trouble(folder, "stage", above=2.0), store, keep_going=True)
    result = run_sync(trouble(folder, "stage", above=10.0), store)
    assert result.ok
    assert computed(result) == {"trouble": 6, "scale": 4}


def test_a_defect_is_one_line_with_its_traceback_in_a_file(folder, store):
    result = run_sync(trouble(folder, "defect"), store)
    path = result.folder / "errors" / "trouble.step_06.txt"
    assert result.errors == [f"trouble/step_06: ZeroDivisionError: a defect; details in {path}"]
    assert "Traceback" in path.read_text()


def test_a_retry_gives_the_same_keys(folder, store, tmp_path):
    result = run_sync(trouble(folder, "flaky"), store, retries=1)
    assert result.ok
    again = run_sync(trouble(folder, "flaky"), Store.open(tmp_path / "other"))
    assert again.ok
    assert index(again) == index(result)


def test_a_product_of_another_kind_is_refused(folder, store):
    (message,) = run_sync(trouble(folder, "kind"), store).errors
    assert message.startswith("trouble/step_06: ")
    assert {"'other'", "'number'"} <= set(message.replace(";", "").split())


def meanwhile(monkeypatch, change):
    """Something happens to each file while it is read."""
    original = toys.Read.run
    monkeypatch.setattr(toys.Read, "run", lambda self, source: change(source) or original(self, source))


def test_a_file_that_changes_while_it_is_read_is_no_result(folder, store, monkeypatch):
    """Though it keeps its size and the time of its last change."""

    def overwrite(source):
        before = source.stat()
        source.write_text("9")
        os.utime(source, ns=(before.st_atime_ns, before.st_mtime_ns))

    meanwhile(monkeypatch, overwrite)
    result = run_sync(chain(folder), store)
    assert ".txt: changed during the run" in result.errors[0]
    assert not (store.path / "actions").exists()


def test_a_file_that_is_only_touched_while_it_is_read_is_the_same(folder, store, monkeypatch):
    meanwhile(monkeypatch, os.utime)
    assert run_sync(chain(folder), store).ok


@pytest.mark.parametrize("scheduler", ["sync", "threads"])
def test_the_first_interrupt_lets_running_tasks_finish(folder, store, scheduler):
    before = signal.getsignal(signal.SIGINT)
    result = run_sync(trouble(folder, "interrupt"), store, scheduler=scheduler)
    assert result.interrupted
    assert result.outcomes["trouble/step_06"].status == "computed"
    assert result.counts["skipped"] > 0
    assert result.counts["failed"] == 0
    assert find_run(store).result["interrupted"]
    assert signal.getsignal(signal.SIGINT) is before


def test_the_second_interrupt_ends_the_run_and_keeps_what_is_done(folder, store):
    def twice(event):
        if event.kind == "finished" and event.stage == "read" and event.step == "step_03":
            os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        run_sync(chain(folder), store, on_event=twice)
    assert "read/step_03" in find_run(store).index


def test_a_run_that_an_error_ends_is_not_recorded_as_complete(folder, store):
    def leave(event):
        if event.kind == "finished":
            raise SystemExit(143)

    with pytest.raises(SystemExit):
        run_sync(chain(folder), store, on_event=leave)
    assert find_run(store).result["interrupted"]


def test_two_runs_at_once_on_one_store(folder, store):
    results = []
    graphs = [chain(folder, sleep_s=0.005) for _ in range(2)]
    threads = [threading.Thread(target=lambda g=g: results.append(run_sync(g, store))) for g in graphs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [result.ok for result in results] == [True, True]
    assert index(results[0]) == index(results[1])
    assert run_sync(chain(folder), store).counts["hit"] == 24


def test_the_journal_holds_what_happened(folder, store):
    seen = []
    result = run(chain(folder), store, pipeline="a", resolved={"x": 1}, options=Options("sync", on_event=seen.append))
    assert [event.kind for event in seen] == ["planned", *["finished"] * 24, "ended"]
    assert seen[0].counts == {"hit": 0, "run": 6, "pending": 18}
    found = find_run(store, pipeline="a")
    assert (found.id, found.resolved, found.pipeline) == (result.run_id, {"x": 1}, "a")
    assert {name: entry["digest"] for name, entry in found.index.items()} == index(result)
    events = [json.loads(line) for line in (found.folder / "journal.jsonl").read_text().splitlines()]
    assert events[1]["status"] == "computed"
    assert found.result["counts"]["computed"] == 24


def test_a_journal_cut_short_by_a_kill_is_still_read(folder, store):
    result = run_sync(chain(folder), store)
    for name in ("index.json", "result.json"):
        (result.folder / name).unlink()
    with (result.folder / "journal.jsonl").open("a") as file:
        file.write('{"kind": "fini')
    found = find_run(store, result.run_id)
    assert found.result is None
    assert {name: entry["digest"] for name, entry in found.index.items()} == index(result)


def test_records_hold_where_results_come_from(folder, store):
    result = run_sync(chain(folder), store)
    made = store.record(result.outcomes["scale/step_01"].key).made
    assert (made["task"], made["run"]) == ("scale/step_01", result.run_id)
    assert made["peak_bytes"] > 1e6
    assert made["versions"]["dicflow"]


def test_the_graph_is_a_plain_mapping_that_can_be_drawn(folder, store):
    graph = dask_graph(make_plan(chain(folder), store), store)
    assert len(graph) == 24
    call, _, *needs = graph["scale", "step_01", "plan"]
    assert (call.__name__, needs) == ("perform", [("read", "step_01", "plan"), ("rig", "plan")])


@pytest.mark.parametrize(
    ("scheduler", "workers", "fact"),
    [("thread", 2, "'threads'"), ("http://x", 2, "'http://x'"), ("threads", 0, "at least 1")],
)
def test_unknown_schedulers_are_refused(folder, store, scheduler, workers, fact):
    with pytest.raises(ConfigurationError, match=fact):
        run_sync(chain(folder), store, scheduler=scheduler, workers=workers)
