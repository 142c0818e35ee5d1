"""The settings that a run keeps: what has another form is unknown, and stops nobody who does not need it."""

import pytest

from dicflow.engine.journal import Journal, RunInfo, runs
from dicflow.engine.store import Store
from dicflow.errors import StoreError
from dicflow.pipeline.resolved import kept_settings, resolved_of

WHOLE = {"stages": {"rig": {"stage": "rig", "inputs": {"corners": "corners"}}}, "variants": [{}]}
ALL = {**WHOLE, "title": "a", "instances": [{"rig": "rig"}], "steps": {"images": ["s_1"]}, "data": "photos"}


@pytest.fixture
def store(tmp_path):
    return Store.open(tmp_path / "store")


def run_with(store, resolved) -> RunInfo:
    Journal(store, "a", resolved).close({}, {"counts": {}, "interrupted": False})
    return runs(store)[0]


@pytest.mark.parametrize("resolved", [WHOLE, ALL])
def test_settings_come_back(store, resolved):
    run = run_with(store, resolved)
    assert kept_settings(run) == resolved_of(run) == resolved


@pytest.mark.parametrize(
    "resolved",
    [None, 5, [], {}, {"stages": WHOLE["stages"]}, {**WHOLE, "variants": None}, {**WHOLE, "variants": {}},
     {**WHOLE, "stages": None}, {**WHOLE, "stages": {"rig": None}}, {**WHOLE, "stages": {"rig": {"stage": "rig"}}},
     {**ALL, "steps": None}, {**ALL, "instances": [None]}, {**ALL, "data": 3}, {**WHOLE, "variantt": [{}]}],
)  # fmt: skip
def test_settings_of_another_form_are_unknown(store, resolved):
    run = run_with(store, resolved)
    assert resolved_of(run) is None
    with pytest.raises(StoreError, match=r"pipeline.json: is damaged, .*name another run"):
        kept_settings(run)


def test_a_damaged_description_leaves_the_time_in_the_runs_name(store):
    run = run_with(store, WHOLE)
    (run.folder / "pipeline.json").write_bytes(b"[" * 100_000)
    again = runs(store)[0]
    assert (again.pipeline, again.resolved) == ("", None)
    assert again.started == int(run.started)


def test_of_a_run_whose_index_is_damaged_nothing_is_shown(copied):
    from small import dicflow

    from dicflow.pipeline import Pipeline

    loaded = Pipeline.load(copied)
    newest = loaded.last_run()
    (newest.folder / "index.json").write_bytes(b"\0" * 300)
    other = Pipeline.load(copied).last_run()
    assert other is None or other.id != newest.id
    dicflow("compare", newest.id, copied).refuses(2, "index.json", "verify")
    assert dicflow("report", copied).code == 0
