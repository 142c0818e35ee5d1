"""Facts of runs whose journals and records are written here as the engine writes them."""

from __future__ import annotations

import pytest

from dicflow.engine.hashing import digest_json
from dicflow.engine.journal import Event, Journal, find_run
from dicflow.engine.records import Record
from dicflow.engine.store import Store
from dicflow.pipeline.provenance import TaskFacts, run_facts

PARTS = {"stage": "surface", "impl_version": 1, "parameters": {}, "inputs": {}, "files": {}}
PLANNED = Event("planned", counts={"hit": 2, "run": 1, "pending": 1})


def entry(name):
    return {"key": digest_json(f"key of {name}"), "digest": digest_json(name)}


@pytest.fixture
def store(tmp_path):
    """A store with records of two steps that took 1.5 s and 2 s, by two versions."""
    store = Store.open(tmp_path / "store")
    for name, seconds, version in (("surface/a", 1.5, "1"), ("surface/b", 2.0, "2")):
        made = {"stage_s": seconds, "versions": {"dicflow": version, "python": "3.11"}}
        store.put_record(Record(entry(name)["key"], PARTS, entry(name)["digest"], "", made))
    return store


@pytest.fixture
def journal(store):
    """A run under way: two tasks were at hand, one failed, one was skipped."""
    journal = Journal(store, "a", {})
    journal.write_index({name: entry(name) for name in ("surface/a", "surface/b")})
    failed = Event("finished", task="rig", stage="rig", status="failed", seconds=0.5, text="rig: no board")
    skipped = Event("finished", task="total/b", stage="total", step="b", status="skipped", text="rig failed")
    for event in (PLANNED, Event("warning", text="beware"), failed, skipped):
        journal.write(event)
    yield journal
    journal.close({}, {})


def facts(store):
    return run_facts(store, find_run(store))


def test_facts_of_a_killed_run(store, journal):
    found = facts(store)
    assert (found.id, found.ended, found.interrupted, found.planned) == (journal.id, False, False, 4)
    assert found.counts == {"hit": 2, "computed": 0, "failed": 1, "skipped": 1}
    assert found.tasks[0] == TaskFacts("surface/a", "surface", "a", "hit", 1.5, *entry("surface/a").values(), "")
    assert found.tasks[2] == TaskFacts("rig", "rig", None, "failed", 0.5, "", "", "rig: no board")
    assert found.warnings == (("", "beware"),)


def test_of_a_run_that_has_grown_the_last_plan_counts(store, journal):
    journal.write(Event("planned", counts={"hit": 4, "pending": 2}))
    assert facts(store).planned == 6


def test_time_saved_is_what_the_products_at_hand_once_took(store, journal):
    journal.write(Event("finished", task="rig@2", stage="rig@2", status="computed", seconds=7.0, **entry("rig@2")))
    assert facts(store).saved_s == 3.5


def test_versions_are_of_those_that_made_the_products(store, journal):
    assert facts(store).versions == {"dicflow": ("1", "2"), "python": ("3.11",)}


def test_an_interrupted_run_has_ended(store, journal):
    index = {name: entry(name) for name in ("surface/a", "surface/b")}
    journal.close(index, {"counts": {}, "interrupted": True})
    found = facts(store)
    assert (found.ended, found.interrupted) == (True, True)


def test_a_hit_that_only_the_worker_found_counts_once(store, journal):
    journal.write(Event("finished", task="surface/b", stage="surface", step="b", status="hit", **entry("surface/b")))
    found = facts(store)
    assert found.counts["hit"] == 2
    assert found.saved_s == 3.5


def test_records_that_were_freed_leave_time_and_versions_open(store, journal):
    for name in ("surface/a", "surface/b"):
        store.record_path(entry(name)["key"]).unlink()
    found = facts(store)
    assert (found.saved_s, found.versions) == (0.0, {})
    assert found.counts["hit"] == 2
