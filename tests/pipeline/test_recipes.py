"""Products of a run that were not kept, made again from its records."""

import shutil

import numpy as np
import pytest

from dicflow.engine.fingerprint import Fingerprint
from dicflow.engine.journal import find_run
from dicflow.engine.references import cache, load
from dicflow.engine.store import Store
from dicflow.pipeline import Pipeline, recipes
from dicflow.pipeline.recipes import run_refs


@pytest.fixture(scope="module")
def strained(pipeline, measured, tmp_path_factory):
    """A run whose strain increments of one more window were not kept, with its store and result."""
    store = shutil.copytree(measured, tmp_path_factory.mktemp("strained") / "store")
    loaded = Pipeline.load(pipeline, store=store, settings=["strain.keep=never", "strain.window=[51, 51]"])
    result = loaded.run(scheduler="sync", workers=1)
    return loaded.store, find_run(loaded.store, result.outcome.run_id), result


def test_what_was_not_kept_is_made_again(strained):
    store, run, result = strained
    ref = run_refs(store, run)["strain/step_02"]
    assert not store.manifest(ref.digest).kept
    assert ref.recipe is not None
    cache.clear()
    np.testing.assert_array_equal(load(store, ref)["gradient"], result.product("strain", "step_02")["gradient"])


def test_kept_products_and_those_made_from_files_have_no_recipe(strained):
    store, run, _ = strained
    refs = run_refs(store, run)
    assert store.manifest(refs["rig"].digest).kept
    assert refs["rig"].recipe is None
    assert not store.manifest(refs["photos/step_00"].digest).kept
    assert refs["photos/step_00"].recipe is None


def test_changed_code_cannot_make_a_product_again(strained, monkeypatch):
    store, run, _ = strained
    monkeypatch.setattr(recipes.Sources, "fingerprint", lambda *_: Fingerprint("other"))
    assert run_refs(Store.open(store.path), run)["strain/step_02"].recipe is None
