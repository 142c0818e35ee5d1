import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from test_execute import index
from toys import chain, run_sync

from dicflow.engine.housekeeping import collect, pin, pins, size, unpin
from dicflow.engine.journal import find_run, runs
from dicflow.engine.verification import verify
from dicflow.errors import StoreError
from tests.replaced import replace_below

pytestmark = pytest.mark.slow


@pytest.fixture
def three(folder, store):
    """Three runs with three factors; only files and rig are common to them."""
    return [run_sync(chain(folder, keep="always", factor=factor), store) for factor in (2.0, 3.0, 5.0)]


def products(garbage):
    return set(garbage.names("manifest", "group"))


def digests(*results):
    return {digest for result in results for digest in index(result).values()}


def test_a_look_shows_what_could_go_and_deletes_nothing(store, three):
    before = size(store)
    found = collect(store, keep_runs=1, grace_s=0)
    assert products(found) == digests(*three[:2]) - digests(three[2])
    assert set(found.names("run")) == {three[0].run_id, three[1].run_id}
    assert not found.deleted
    assert 0 < found.nbytes < before
    assert size(store) == before


@pytest.fixture
def deep(monkeypatch):
    """Makes folders inside each other, more than Python's calls may lie inside each other; deletes them again."""
    tops = []

    def make(folder):
        folder.mkdir(parents=True, exist_ok=True)
        tops.append(folder)
        with monkeypatch.context() as context:
            context.chdir(folder)
            for _ in range(sys.getrecursionlimit() + 100):
                os.mkdir("a")
                os.chdir("a")
        return folder

    yield make
    subprocess.run(["rm", "-rf", *tops], check=True)


def test_folders_of_any_depth_are_left_alone(store, three, deep):
    places = "tmp/00000000-1-12345678", "thesis", "quarantine/x.12345678"
    made = [deep(store.path / place) for place in places]
    bytes_before = size(store)
    found = collect(store, keep_runs=1, grace_s=0, delete=True)
    assert all((folder / "a").is_dir() for folder in made)
    assert {path.relative_to(store.path).parts[0] for path in found.foreign} >= {"thesis", "quarantine"}
    assert size(store) < bytes_before
    assert {damage.state for damage in verify(store)} == {"foreign"}


def test_deleting_frees_what_was_shown_and_keeps_the_rest(folder, store, three):
    shown = collect(store, keep_runs=1, grace_s=0)
    before = size(store) - store.index.path.stat().st_size
    gone = collect(store, keep_runs=1, grace_s=0, delete=True)
    assert (gone.found, gone.deleted) == (shown.found, True)
    assert not any(one.path.exists() for one in shown.found)
    assert before - (size(store) - store.index.path.stat().st_size) == shown.nbytes
    assert len(store.index.read()) == 24
    assert verify(store) == []
    assert run_sync(chain(folder, keep="always", factor=5.0), store).counts["hit"] == 24
    assert run_sync(chain(folder, keep="always", factor=2.0), store).counts == {
        "hit": 7, "computed": 17, "failed": 0, "skipped": 0,
    }  # fmt: skip


def test_the_newest_runs_of_each_pipeline_and_pinned_ones_stay(store, three):
    assert [run.id for run in runs(store)] == [result.run_id for result in reversed(three)]
    assert not products(collect(store, keep_runs=3, grace_s=0))
    pin(store, three[0].run_id, "as published")
    assert products(collect(store, keep_runs=1, grace_s=0)) == digests(three[1]) - digests(three[0], three[2])
    assert pins(store) == {three[0].run_id: "as published"}
    unpin(store, three[0].run_id)
    assert set(collect(store, keep_runs=1, grace_s=0).names("run")) == {three[0].run_id, three[1].run_id}


def test_one_product_can_be_pinned(store, three):
    digest = index(three[0])["report"]
    pin(store, digest)
    assert digest not in products(collect(store, keep_runs=1, grace_s=0))


def test_the_latest_run_is_pinned_by_its_id(folder, store, three):
    pin(store, "latest")
    run_sync(chain(folder, keep="always", factor=7.0), store)
    assert pins(store) == {three[2].run_id: ""}
    assert three[2].run_id not in collect(store, keep_runs=1, grace_s=0).names("run")


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
    found = products(collect(store, keep_runs=1, grace_s=0))
    assert not {index(three[2])[name] for name in made} & found


@pytest.mark.parametrize("damage", ["", "[]", '{"a": ', '{"a": 5}', "\0" * 512])
def test_nothing_is_deleted_while_it_is_unknown_what_must_stay(store, three, damage):
    pin(store, three[0].run_id)
    index_path, before = three[1].folder / "index.json", size(store)
    for path in (store.path / "pins.json", index_path):
        sound = path.read_text()
        path.write_text(damage)
        with pytest.raises(StoreError, match=f"{path.name}: (is empty|is not JSON|holds something else)"):
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
    assert collect(store, keep_runs=0).found == []


def aged(folder, seconds):
    """Everything in a folder, as if it had been written so long ago."""
    then = time.time() - seconds
    for path in sorted(folder.rglob("*"), reverse=True):
        os.utime(path, (then, then))


def test_a_run_that_still_writes_its_journal_stays_with_its_products(store, three):
    aged(store.path, 7200.0)
    assert set(collect(store, keep_runs=1).names("run")) == {three[0].run_id, three[1].run_id}
    with (three[0].folder / "journal.jsonl").open("a") as journal:
        journal.write("\n")
    found = collect(store, keep_runs=1)
    assert found.names("run") == [three[1].run_id]
    assert products(found) == digests(three[1]) - digests(three[0], three[2])


def test_a_pin_is_never_dropped_in_silence(store, three):
    """A pinned run whose index has gone needs nobody knows what."""
    pin(store, three[0].run_id)
    index_path = three[0].folder / "index.json"
    sound = index_path.read_bytes()
    index_path.unlink()
    with pytest.raises(StoreError, match=r"the pinned run .* has lost its index.*--remove"):
        collect(store, keep_runs=1, grace_s=0, delete=True)
    index_path.write_bytes(sound)
    assert three[0].run_id not in collect(store, keep_runs=1, grace_s=0).names("run")


def test_a_damaged_journal_of_a_run_that_has_ended_loses_nothing(store, three):
    """Its index names all products."""
    (three[2].folder / "journal.jsonl").write_bytes(b"x" * 900 + b"\n")
    assert not products(collect(store, keep_runs=1, grace_s=0)) & digests(three[2])


THESIS = ("thesis.doc", "aa/photo.png", f"aa/{'a' * 64}.json", f"{'a' * 64}/zarr.json", "x.12345678", "1-12345678")
"""Files of somebody else, some of them named as a store would name its own."""


@pytest.fixture
def thesis(tmp_path):
    """A folder of somebody else, years old."""
    for name in THESIS:
        (tmp_path / "thesis" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "thesis" / name).write_text("all my work")
    aged(tmp_path / "thesis", 1e8)
    yield tmp_path / "thesis"
    assert {name for name in THESIS if (tmp_path / "thesis" / name).read_text() == "all my work"} == set(THESIS)


@pytest.mark.parametrize(
    "place",
    ["quarantine", "tmp", "objects", "objects/zz", "objects/aa", "actions", "actions/aa", "code", "runs", "runs/latest",
     "runs/20200101-000000-abcdef", f"objects/aa/{'a' * 64}", f"code/{'a' * 64}.json", "tmp/1-12345678",
     "quarantine/x.12345678", "notes"],
)  # fmt: skip
@pytest.mark.parametrize("is_whole", [True, False])
def test_no_link_is_followed(store, thesis, place, is_whole):
    """Neither one that is deleted with what is around it, nor one in the place of a part of the store."""
    link = store.path / place
    link.parent.mkdir(parents=True, exist_ok=True)
    if link.is_dir():
        link.rmdir()
    link.symlink_to(thesis if is_whole else thesis / "aa", target_is_directory=True)
    shown = collect(store, keep_runs=0, grace_s=0)
    assert (shown.found, shown.nbytes, shown.foreign) == ([], 0, [link])
    gone = collect(store, keep_runs=0, grace_s=0, delete=True)
    assert (gone.found, gone.foreign) == ([], [link])
    assert link.is_symlink()


@pytest.mark.parametrize(
    "place", ["{group}/values/link", "{group}/notes.txt", "{group}/values/notes.txt", "{run}/link"]
)
def test_a_folder_that_holds_something_foreign_is_left_alone(store, three, thesis, place):
    group, run = store.object_path(index(three[0])["scale/step_01"]), three[0].folder
    stranger = store.path / place.format(group=group, run=run)
    stranger.symlink_to(thesis) if "link" in place else stranger.write_text("keep me")
    gone = collect(store, keep_runs=0, grace_s=0, delete=True)
    assert gone.foreign == [stranger]
    assert stranger.exists()
    assert len(list((store.path / "runs").glob("2*"))) == ("run" in place)


@pytest.mark.parametrize("name", ["left by me", "notes.txt", "tmp/letter.doc", "objects/aa/photo.png", "code/x.py"])
def test_names_of_others_are_left_and_named(store, three, name):
    (store.path / name).parent.mkdir(parents=True, exist_ok=True)
    (store.path / name).write_text("x")
    aged(store.path, 1e8)
    assert collect(store, keep_runs=0, delete=True).foreign == [store.path / name]
    assert (store.path / name).exists()


def test_the_next_gc_takes_what_a_killed_one_leaves(folder, store, three, monkeypatch):
    """It deletes first what names others, so that nothing is damaged at any moment."""
    for allowed in range(0, 40, 7):
        with monkeypatch.context() as patch:
            kill_after(patch, store, allowed)
            with pytest.raises(KeyboardInterrupt):
                collect(store, keep_runs=1, grace_s=0, delete=True)
        assert verify(store) == []
        assert run_sync(chain(folder, keep="always", factor=5.0), store).counts["hit"] == 24
        run_sync(chain(folder, keep="always"), store)
        run_sync(chain(folder, keep="always", factor=5.0), store)
    collect(store, keep_runs=1, grace_s=0, delete=True)
    assert collect(store, keep_runs=1, grace_s=0).found == []


def kill_after(patch, store, allowed):
    """Interrupt the deletion after so many files and folders of a store."""
    left, unlink, rmtree = [allowed], Path.unlink, shutil.rmtree

    def counted(function):
        def call(*arguments, **options):
            left[0] -= 1
            if left[0] < 0:
                raise KeyboardInterrupt
            return function(*arguments, **options)

        return call

    replace_below(patch, store.path, Path, "unlink", counted(unlink))
    replace_below(patch, store.path, shutil, "rmtree", counted(rmtree))
