import json
import os
import time

import pytest
from test_execute import index
from toys import chain, run_sync

from dicflow.engine.housekeeping import collect, pin, pins, size, unpin
from dicflow.engine.journal import find_run, runs
from dicflow.engine.verification import verify
from dicflow.errors import StoreError


@pytest.fixture
def three(folder, store):
    """Three runs with three factors; only files and rig are common to them."""
    return [run_sync(chain(folder, keep="always", factor=factor), store) for factor in (2.0, 3.0, 5.0)]


def digests(*results):
    return {digest for result in results for digest in index(result).values()}


def test_a_look_shows_what_could_go_and_deletes_nothing(store, three):
    before = size(store)
    found = collect(store, keep_runs=1, grace_s=0)
    assert set(found.objects) == digests(*three[:2]) - digests(three[2])
    assert set(found.runs) == {three[0].run_id, three[1].run_id}
    assert not found.deleted
    assert 0 < found.nbytes < before
    assert size(store) == before


def test_deleting_frees_what_was_shown_and_keeps_the_rest(folder, store, three):
    shown = collect(store, keep_runs=1, grace_s=0)
    before = size(store) - store.index.path.stat().st_size
    gone = collect(store, keep_runs=1, grace_s=0, delete=True)
    assert (gone.objects, gone.deleted) == (shown.objects, True)
    assert before - (size(store) - store.index.path.stat().st_size) == shown.nbytes
    assert len(store.index.read()) == 24
    assert verify(store) == []
    assert run_sync(chain(folder, keep="always", factor=5.0), store).counts["hit"] == 24
    assert run_sync(chain(folder, keep="always", factor=2.0), store).counts == {
        "hit": 7, "computed": 17, "failed": 0, "skipped": 0,
    }  # fmt: skip


def test_the_newest_runs_of_each_pipeline_and_pinned_ones_stay(store, three):
    assert [run.id for run in runs(store)] == [result.run_id for result in reversed(three)]
    assert collect(store, keep_runs=3, grace_s=0).objects == []
    pin(store, three[0].run_id, "as published")
    assert set(collect(store, keep_runs=1, grace_s=0).objects) == digests(three[1]) - digests(three[0], three[2])
    assert pins(store) == {three[0].run_id: "as published"}
    unpin(store, three[0].run_id)
    assert set(collect(store, keep_runs=1, grace_s=0).runs) == {three[0].run_id, three[1].run_id}


def test_one_product_can_be_pinned(store, three):
    digest = index(three[0])["report"]
    pin(store, digest)
    assert digest not in collect(store, keep_runs=1, grace_s=0).objects


def test_the_latest_run_is_pinned_by_its_id(folder, store, three):
    pin(store, "latest")
    run_sync(chain(folder, keep="always", factor=7.0), store)
    assert pins(store) == {three[2].run_id: ""}
    assert three[2].run_id not in collect(store, keep_runs=1, grace_s=0).runs


def test_a_product_that_is_not_stored_is_kept_by_its_run(folder, store):
    result = run_sync(chain(folder, keep="never"), store)
    with pytest.raises(StoreError, match="pin its run"):
        pin(store, index(result)["scale/step_02"])
    assert pins(store) == {}


@pytest.mark.parametrize("what", ["20200101-000000-abcdef", "sha256:" + "0" * 64, "../x"])
def test_only_what_is_there_can_be_pinned(store, what):
    with pytest.raises(StoreError):
        pin(store, what)
    with pytest.raises(StoreError, match="is not pinned"):
        unpin(store, what)


def test_a_run_under_way_keeps_what_its_journal_tells_of(store, three):
    (three[2].folder / "index.json").unlink()
    made = {name for name, outcome in three[2].outcomes.items() if outcome.status == "computed"}
    assert len(made) == 17
    assert set(find_run(store, three[2].run_id).index) == made
    found = collect(store, keep_runs=1, grace_s=0).objects
    assert not {index(three[2])[name] for name in made} & set(found)


@pytest.mark.parametrize("damage", ["", "[]", '{"a": '])
def test_nothing_is_deleted_while_it_is_unknown_what_must_stay(store, three, damage):
    pin(store, three[0].run_id)
    index_path, before = three[1].folder / "index.json", size(store)
    for path in (store.path / "pins.json", index_path):
        sound = path.read_text()
        path.write_text(damage)
        with pytest.raises(StoreError, match=f"{path.name}: is not a mapping"):
            collect(store, keep_runs=2, grace_s=0, delete=True)
        path.write_text(sound)
    assert size(store) == before


def test_code_goes_with_the_last_record_that_names_it(store, three):
    kept = {store.code_path(store.record(outcome.key).code) for outcome in three[2].outcomes.values()}
    root = "sha256:" + "0" * 64
    store.put_code(root, {"m:f": root})
    collect(store, keep_runs=1, delete=True)
    assert store.code_path(root).exists()
    collect(store, keep_runs=1, grace_s=0, delete=True)
    assert set((store.path / "code").iterdir()) == kept
    collect(store, keep_runs=0, grace_s=0, delete=True)
    assert not list((store.path / "code").iterdir())


def test_what_is_young_stays(store, three):
    (store.path / "tmp" / "left by a kill").mkdir()
    assert collect(store, keep_runs=0).objects == []
    assert collect(store, keep_runs=0).leftovers == []
    assert collect(store, keep_runs=0, grace_s=0).leftovers == ["tmp/left by a kill"]


def aged(folder, seconds):
    """Everything in a folder, as if it had been written so long ago."""
    then = time.time() - seconds
    for path in sorted(folder.rglob("*"), reverse=True):
        os.utime(path, (then, then))


def test_a_run_that_still_writes_its_journal_stays_with_its_products(store, three):
    aged(store.path, 7200.0)
    assert set(collect(store, keep_runs=1).runs) == {three[0].run_id, three[1].run_id}
    with (three[0].folder / "journal.jsonl").open("a") as journal:
        journal.write("\n")
    found = collect(store, keep_runs=1)
    assert found.runs == [three[1].run_id]
    assert set(found.objects) == digests(three[1]) - digests(three[0], three[2])


def test_verify_finds_all_kinds_of_damage_and_mends_them(folder, store, three):
    found = index(three[0])
    victims = [found[name] for name in ("scale/step_01", "scale/step_02", "scale/step_03", "rig")]
    chunk, metadata = (store.object_path(victims[n]) / "values" / name for n, name in ((0, "c.0"), (1, "zarr.json")))
    content = bytearray(chunk.read_bytes())
    content[20] ^= 1
    chunk.write_bytes(content)
    metadata.unlink()
    for victim, change in ((victims[2], ("mm", "cm")), (victims[3], ("3.5", "4.5"))):
        manifest = store.object_path(victim).with_suffix(".json")
        manifest.write_text(manifest.read_text().replace(*change))
    key = three[0].outcomes["report"].key
    record = store.record_path(key)
    record.write_text(json.dumps({**json.loads(record.read_text()), "parts": {}}))
    assert {damage.what for damage in verify(store)} == {*victims, key}
    verify(store, repair=True)
    assert verify(store) == []
    again = run_sync(chain(folder, keep="always"), store)
    assert again.ok
    assert index(again) == found
