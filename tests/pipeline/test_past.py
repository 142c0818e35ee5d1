"""Results of earlier runs: with their own settings and steps, and with a sentence on what is gone."""

import json
import shutil

import numpy as np
import pytest
from small import ROOT

from dicflow.engine.journal import find_run, runs
from dicflow.engine.references import cache
from dicflow.errors import StoreError
from dicflow.pipeline import Pipeline
from dicflow.pipeline.past import past_result
from dicflow.pipeline.registry import node_class


@pytest.fixture(scope="module")
def twice(pipeline, measured, tmp_path_factory):
    """A pipeline file with another window of the strain, after a run with either; its store is a copy."""
    path = shutil.copytree(pipeline.parent, tmp_path_factory.mktemp("twice") / "small") / pipeline.name
    path.write_text(path.read_text().replace("stage: strain, ", "stage: strain, window: [61, 61], ", 1))
    loaded = Pipeline.load(path)
    assert loaded.resolved()["stages"] != Pipeline.load(pipeline).resolved()["stages"]
    assert loaded.run(scheduler="sync", workers=1).outcome.ok
    return path


@pytest.fixture
def apart(twice, tmp_path):
    """The same in a folder that may be changed."""
    cache.clear()
    return shutil.copytree(twice.parent, tmp_path / "copy") / twice.name


def first_run(path):
    return runs(Pipeline.load(path).store)[-1]


def test_an_earlier_run_has_its_own_products(twice, pipeline, measured):
    before, now = Pipeline.load(pipeline).result(), Pipeline.load(twice).result()
    found = Pipeline.load(twice).past_result(first_run(twice).id)
    assert (found.digests, found.notes, found.values) == (before.digests, (), before.values)
    assert found.steps("total") == before.steps("total")
    total = found.product("total", -1)
    np.testing.assert_array_equal(total["eyy"], before.product("total", -1)["eyy"])
    assert (total["eyy"] != now.product("total", -1)["eyy"]).any()


def test_photographs_that_are_still_there_are_read_again(twice):
    run = first_run(twice)
    loaded = Pipeline.load(twice)
    assert not past_result(loaded.store, run).has("photos", 0)
    cache.clear()
    found, now = loaded.past_result(run.id), loaded.result()
    np.testing.assert_array_equal(found.product("photos", 1)["left"], now.product("photos", 1)["left"])


def test_without_photographs_all_that_is_stored_can_be_had(apart):
    shutil.rmtree(apart.parent / "photos")
    found = Pipeline.load(apart).past_result(first_run(apart).id)
    assert np.isfinite(found.product("total", -1)["eyy"]).any()
    assert not found.has("photos", 0)


def test_what_was_cleaned_up_is_said(apart):
    loaded = Pipeline.load(apart)
    run = first_run(apart)
    steps = loaded.result().steps("total")
    lost = run.index[f"total/{steps[-1]}"]["digest"]
    loaded.store.manifest_path(lost).unlink()
    loaded = Pipeline.load(apart)
    found = loaded.past_result(run.id)
    assert not found.has("total", steps[-1])
    assert found.has("total", steps[0])
    (note,) = found.notes
    assert note == f"1 of {len(steps)} products of 'total' of run {run.id} were cleaned up or set aside as damaged."


def test_a_run_that_was_cleaned_up_is_unknown(apart):
    run = first_run(apart)
    shutil.rmtree(run.folder)
    with pytest.raises(StoreError, match=f"unknown run '{run.id}'; it was cleaned up"):
        Pipeline.load(apart).past_result(run.id)


def changed(path, change):
    """A run whose settings were changed; the store checks sums, so they are set behind its back."""
    run = find_run(Pipeline.load(path).store, first_run(path).id)
    resolved = json.loads(json.dumps(run.resolved))
    change(resolved)
    run.__dict__["_about"] = {**run._about, "resolved": resolved}
    return run


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda found: found["stages"]["strain"].update(stage="wind"), "does not know"),
        (lambda found: found["stages"]["strain"].update(winding=3), "does not know"),
        (lambda found: found["stages"]["strain"]["inputs"].update(increment="nothing"), "does not know"),
        (lambda found: found.pop("steps"), "does not say which steps"),
        (lambda found: found["instances"][0].update(strain="nothing"), "do not fit"),
        (lambda found: found["instances"].append({}), "do not fit"),
        (lambda found: found["steps"].update(photos=["../x"]), "names a step"),
    ],
)
def test_a_run_of_other_code_or_a_strange_store_is_refused(twice, change, words):
    with pytest.raises(StoreError, match=words):
        past_result(Pipeline.load(twice).store, changed(twice, change))


def test_no_file_is_looked_for(twice, tmp_path):
    """Photographs that a store names without steps have none, wherever they lie."""
    (tmp_path / "1.png").write_bytes(b"")
    run = changed(twice, lambda found: found["steps"].pop("boards"))
    run.resolved["stages"]["boards"].update(left=str(tmp_path / "*.png"), right=str(tmp_path / "*.png"))
    assert past_result(Pipeline.load(twice).store, run).steps("boards") == ()


@pytest.mark.parametrize("path", sorted((ROOT / "pipelines").glob("*.yaml")), ids=lambda path: path.stem)
def test_settings_of_every_stage_survive_the_store(path):
    resolved = json.loads(json.dumps(Pipeline.load(path, data=ROOT / "data_samples").resolved()))
    for entry in resolved["stages"].values():
        node = node_class(entry["stage"]).model_validate({k: v for k, v in entry.items() if k != "inputs"})
        again = json.loads(json.dumps(node.model_dump(mode="json")))
        assert {**again, "inputs": entry["inputs"]} == entry
