import errno
import json
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray
from toys import chain, edit_json, field, run_sync

from dicflow.engine import zarr_files
from dicflow.engine.objects import describe, normalised
from dicflow.engine.product import Product, Variable
from dicflow.engine.records import Record, versions
from dicflow.engine.references import Ref, load
from dicflow.engine.store import FORMAT, Store
from dicflow.errors import DamagedError, StageError, StoreError
from tests.replaced import replace_below

ROOT = getattr(os, "geteuid", lambda: 1)() == 0


def put(store, product, keep=True):
    product = normalised(product)
    return store.put(product, describe(product), keep)


def cloud(rows=400):
    rng = np.random.default_rng(1)
    xyz = rng.normal(size=(rows, 600, 3)).astype(np.float32)
    xyz[0, 0] = np.nan
    return Product(
        "cloud",
        {
            "xyz": Variable(("row", "col", "component"), xyz, "mm", "position"),
            "status": Variable(("row", "col"), rng.integers(0, 5, (rows, 600)).astype(np.uint8), "1", "reason"),
            "nothing": Variable(("feature",), np.zeros(0), "px", "nothing"),
            "one": Variable((), np.array(3.5), "mm", "a number"),
        },
        {"origin": [1.5, 2.5], "summary": {"valid_share": 0.9}},
    )


def test_a_product_comes_back_as_it_was(store):
    before = cloud()
    after = load(store, Ref(put(store, before).digest))
    assert (after.kind, after.attrs) == (before.kind, before.attrs)
    assert list(after.variables) == list(before.variables)
    for name, variable in before.variables.items():
        np.testing.assert_array_equal(after[name], variable.values)
        assert after[name].dtype == variable.values.dtype
        assert after.variables[name][0::2] == variable[0::2]


def test_arrays_are_read_when_they_are_used(store, monkeypatch):
    digest = put(store, cloud()).digest
    read = []

    def take(_folder, _manifest, name):
        read.append(name)
        return np.zeros(1)

    monkeypatch.setattr("dicflow.engine.references.stored_array", take)
    product = load(store, Ref(digest))
    assert "xyz" in product
    assert read == []
    assert product["status"] is product["status"]
    assert read == ["status"]


def test_xarray_opens_a_stored_product(store):
    digest = put(store, cloud()).digest
    with xarray.open_zarr(store.object_path(digest), consolidated=False) as dataset:
        assert dataset.xyz.dims == ("row", "col", "component")
        assert dataset.xyz.attrs == {"units": "mm", "long_name": "position"}
        np.testing.assert_array_equal(dataset.xyz.values, cloud()["xyz"])
        assert dataset.attrs["origin"] == [1.5, 2.5]


def test_a_large_field_has_one_chunk_per_plane():
    assert zarr_files._chunk((1200, 2400, 3), 69_000_000) == (1200, 2400, 1)
    assert zarr_files._chunk((1200, 2400), 23_000_000) == (1200, 2400)
    assert zarr_files._chunk((40, 40, 3), 38_400) == (40, 40, 3)


def test_a_product_without_arrays_is_one_file(store):
    digest = put(store, Product("rig", attrs={"a": (1, 2)})).digest
    assert not store.object_path(digest).exists()
    assert load(store, Ref(digest)).attrs == {"a": [1, 2]}


def test_one_content_is_kept_once(store):
    first = put(store, cloud())
    path = store.object_path(first.digest).with_suffix(".json")
    inode = path.stat().st_ino
    assert put(store, cloud()) == first
    assert path.stat().st_ino == inode
    assert not list((store.path / "tmp").iterdir())


def test_what_was_not_kept_can_be_kept_later(store):
    alone = put(store, field("a", [1.0]), keep=False)
    assert (alone.kept, store.inspect(alone.digest)[0]) == (False, "complete")
    with pytest.raises(StoreError, match="was not kept; run the pipeline again"):
        load(store, Ref(alone.digest))["values"]
    assert put(store, field("a", [1.0])).kept
    assert load(store, Ref(alone.digest))["values"] == [1.0]


def test_losing_or_cutting_any_file_of_an_object_is_noticed(store):
    digest = put(store, cloud()).digest
    folder = store.object_path(digest)
    for path in [path for path in sorted(folder.rglob("*")) if path.is_file()]:
        content = path.read_bytes()
        path.write_bytes(content[:-1])
        assert store.inspect(digest)[0] == "damaged", path
        path.unlink()
        assert store.inspect(digest)[0] == "damaged", path
        path.write_bytes(content)
    assert store.inspect(digest)[0] == "complete"
    shutil.rmtree(folder)
    assert store.inspect(digest)[0] == "damaged"


def test_a_damaged_object_is_replaced(store):
    digest = put(store, cloud()).digest
    store.object_path(digest).with_suffix(".json").write_text("{")
    put(store, cloud())
    assert store.inspect(digest)[0] == "complete"
    assert len(list((store.path / "quarantine").iterdir())) == 2


def test_arrays_left_by_a_killed_writer_are_taken_over_or_put_aside(store):
    """The arrays were renamed, the manifest was not written."""
    digest = put(store, cloud()).digest
    manifest = store.object_path(digest).with_suffix(".json")
    manifest.unlink()
    assert store.inspect(digest)[0] == "missing"
    put(store, cloud())
    assert not (store.path / "quarantine").exists()
    manifest.unlink()
    next((store.object_path(digest) / "xyz").glob("c.*")).rename(store.path / "elsewhere")
    put(store, cloud())
    assert len(list((store.path / "quarantine").iterdir())) == 1
    np.testing.assert_array_equal(load(store, Ref(digest))["xyz"], cloud()["xyz"])


def test_a_flipped_bit_is_found_by_the_check_sum(store):
    digest = put(store, cloud()).digest
    chunk = next((store.object_path(digest) / "xyz").glob("c.*"))
    content = bytearray(chunk.read_bytes())
    content[len(content) // 2] ^= 1
    chunk.write_bytes(content)
    assert store.inspect(digest)[0] == "complete"
    with pytest.raises(DamagedError, match="quarantine; run again"):
        load(store, Ref(digest))["xyz"]
    assert store.inspect(digest)[0] == "missing"


@pytest.mark.parametrize("change", [("1.5", "1.25"), ("1.5", "NaN"), ('"mm"', '"cm"')])
def test_a_changed_manifest_is_found_by_its_digest(store, change):
    digest = put(store, cloud()).digest
    manifest = store.object_path(digest).with_suffix(".json")
    manifest.write_text(manifest.read_text().replace(*change))
    with pytest.raises(DamagedError, match=r"json: .*quarantine; run again"):
        load(store, Ref(digest))
    assert store.inspect(digest)[0] == "missing"


def test_what_could_not_be_read_but_is_whole_stays(store, monkeypatch):
    digest = put(store, cloud()).digest

    def failing(folder, manifest, name):
        raise RuntimeError("no thread could be started")

    monkeypatch.setattr("dicflow.engine.references.stored_array", failing)
    with pytest.raises(StoreError, match=r"no thread could be started.*is not damaged; run again") as caught:
        load(store, Ref(digest))["xyz"]
    assert not isinstance(caught.value, DamagedError)
    assert store.inspect(digest)[0] == "complete"


def test_two_processes_may_quarantine_the_same(store, monkeypatch):
    digest = put(store, cloud()).digest
    rename = os.rename

    def late(source, target):
        rename(source, target)
        rename(source, target)

    replace_below(monkeypatch, store.path, os, "rename", late)
    store.quarantine(digest)
    assert store.inspect(digest)[0] == "missing"


@pytest.mark.parametrize("name", ["../../secret", "/etc/passwd", "a/../../b", "..\\x"])
def test_no_path_leads_out_of_the_store(store, name):
    manifest = put(store, cloud())
    path, content = store.manifest_path(manifest.digest), manifest.content
    variables = {**content["variables"], name: content["variables"]["one"]}
    for changes in ({"files": {name: 1}}, {"content": {**content, "variables": variables}}):
        put(store, cloud())
        edit_json(path, **changes)
        assert store.manifest(manifest.digest) is None
    with pytest.raises(StoreError, match="is not a digest"):
        store.object_path(f"sha256:{name}")
    with pytest.raises(StageError, match="cannot name an array"):
        normalised(Product("a", {name: Variable((), np.array(1.0))}))


@pytest.mark.parametrize(
    ("product", "message"),
    [
        (Product("a", {"b": Variable(("row",), np.array([object()]))}), "object has no digest"),
        (Product("a", {"b": Variable(("row",), np.zeros((2, 2)))}), "2 axes, but dims"),
        (Product("a", {"b": np.zeros(2)}), r"a.b: is ndarray; give Variable\("),
        (Product("a", attrs={"b": np.zeros(2)}), "an attribute cannot be kept"),
    ],
)
def test_what_cannot_be_kept_is_refused(product, message):
    with pytest.raises(StageError, match=message):
        describe(normalised(product))


ROOT_OF_CODE = "sha256:" + "c" * 64
PARTS = {"stage": "x", "impl_version": 1, "parameters": {}, "inputs": {}, "files": {}}
RECORD = Record("sha256:" + "a" * 64, PARTS, "sha256:" + "b" * 64, ROOT_OF_CODE, {"task": "x"})


def test_a_record_comes_back(store):
    store.put_record(RECORD)
    assert store.record(RECORD.key) == RECORD
    store.record_path(RECORD.key).write_text('{"key": 3}')
    assert store.record(RECORD.key) is None


@pytest.mark.parametrize("code", [{"m": ROOT_OF_CODE}, "", None, 3])
def test_a_record_with_code_in_another_form_was_made_by_other_code(store, code):
    store.write_json(store.record_path(RECORD.key), {**RECORD.to_json(), "code": code})
    assert store.record(RECORD.key) == replace(RECORD, code="")


@pytest.mark.parametrize("damage", ["", "[]", '{"m:f": '])
def test_the_definitions_of_a_fingerprint_come_back(store, damage):
    assert store.code_parts(ROOT_OF_CODE) == store.code_parts("") == {}
    store.put_code(ROOT_OF_CODE, {"m:f": "sha256:d"})
    store.put_code(ROOT_OF_CODE, {"m:f": "left as it was"})
    assert store.code_parts(ROOT_OF_CODE) == {"m:f": "sha256:d"}
    store.code_path(ROOT_OF_CODE).write_text(damage)
    assert Store.open(store.path).code_parts(ROOT_OF_CODE) == {}


def test_versions_name_what_results_depend_on():
    assert {"python", "dicflow", "numpy", "zarr"} <= set(versions())


@pytest.mark.parametrize("other", [FORMAT - 1, FORMAT + 1, "x"])
def test_another_format_is_refused(store, other):
    (store.path / "dicflow.json").write_text(json.dumps({"format": other}))
    with pytest.raises(StoreError, match=r"this release reads 2; use the dicflow that wrote it"):
        Store.open(store.path)


@pytest.mark.parametrize("text", ["", "[]", "{}", "[" * 100_000, '{"crc32":"00000000","format":2}'])
def test_a_damaged_mark_is_made_again_where_all_else_is_of_a_store(store, text):
    """Whoever only maintains a store does not guess its format."""
    store.mark.write_text(text)
    with pytest.raises(StoreError, match=r"is damaged; .dicflow verify .* --repair. makes it again"):
        Store.open(store.path, create=False)
    (store.path / "thesis.doc").touch()
    with pytest.raises(
        StoreError, match=r"dicflow.json: .*is not that of a store either; name another folder, or write"
    ):
        Store.open(store.path)
    (store.path / "thesis.doc").unlink()
    Store.open(store.path)
    assert Store.open(store.path, create=False).mark_state() == "complete"


def test_a_folder_of_other_things_is_no_store(tmp_path):
    (tmp_path / "thesis.doc").touch()
    with pytest.raises(StoreError, match="holds other files and is not a store"):
        Store.open(tmp_path)
    with pytest.raises(StoreError, match="is not a store; run a pipeline first"):
        Store.open(tmp_path / "nothing", create=False)


@pytest.mark.parametrize("names", [("tmp/photo.png",), ("notes.txt", "tmp/1-" + "a" * 32)])
def test_a_folder_with_a_tmp_of_its_own_is_no_store(tmp_path, names):
    (tmp_path / "tmp").mkdir()
    for name in names:
        (tmp_path / name).touch()
    with pytest.raises(StoreError, match="holds other files and is not a store"):
        Store.open(tmp_path)
    assert not (tmp_path / "dicflow.json").exists()


def test_a_store_that_was_killed_before_its_mark_is_taken_over(tmp_path):
    (tmp_path / "tmp").mkdir()
    (tmp_path / "tmp" / ("1-" + "a" * 32)).touch()
    Store.open(tmp_path)
    assert (tmp_path / "dicflow.json").is_file()


def test_a_store_that_is_being_made_is_not_there_yet(tmp_path):
    assert Store.existing(tmp_path / "store") is None
    (tmp_path / "store" / "tmp").mkdir(parents=True)
    assert Store.existing(tmp_path / "store") is None
    (tmp_path / "store" / "tmp" / ("1-" + "a" * 32)).touch()
    assert Store.existing(tmp_path / "store") is None
    Store.open(tmp_path / "store")
    assert Store.existing(tmp_path / "store").mark_state() == "complete"
    with pytest.raises(StoreError, match="is not a store"):
        Store.existing(tmp_path)


def fill_disk(monkeypatch, store, after):
    """From so many writes on, the disk of a store is full."""
    left = [after]
    original = Path.write_bytes, Path.write_text

    def limited(function):
        def write(*arguments, **options):
            left[0] -= 1
            if left[0] < 0:
                raise OSError(errno.ENOSPC, "No space left on device")
            return function(*arguments, **options)

        return write

    replace_below(monkeypatch, store.path, Path, "write_bytes", limited(original[0]))
    replace_below(monkeypatch, store.path, Path, "write_text", limited(original[1]))


@pytest.mark.parametrize("after", [0, 4, 8, 13, 20])
def test_a_full_disk_is_told_and_loses_nothing(folder, store, monkeypatch, after):
    graph = chain(folder, keep="always")
    run_sync(graph.upstream(["read"]), store)
    with monkeypatch.context() as patch:
        fill_disk(patch, store, after)
        try:
            message = "\n".join(run_sync(graph, store).errors)
        except StoreError as error:
            message = str(error)
    assert "the disk is full; free some space" in message
    assert not list((store.path / "tmp").iterdir())
    again = run_sync(graph, store)
    assert again.ok
    assert again.counts["hit"] >= 6
    assert run_sync(graph, store).counts["hit"] == len(graph.tasks)


def mount(place, options):
    """Whether a disk could be mounted; that needs root, and not every container lets it."""
    return ROOT and subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", place]).returncode == 0


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 300 kB."""
    place = tmp_path / "disk"
    place.mkdir()
    if not mount(place, "size=300k"):
        pytest.skip("mounting a disk is not permitted here")
    yield place
    subprocess.run(["umount", place], check=True)


@pytest.fixture
def read_only(tmp_path):
    """A folder, and a function that makes it read-only; root, whom no permission stops, mounts a disk there."""
    place = tmp_path / "place"
    place.mkdir()
    mounted = mount(place, "size=10m")
    if ROOT and not mounted:
        pytest.skip("root may write everywhere, and mounting a disk is not permitted here")

    def folders():
        return [path for path in [place, *place.rglob("*")] if path.is_dir()]

    def lock():
        if mounted:
            subprocess.run(["mount", "-o", "remount,ro", place], check=True)
        else:
            for path in folders():
                path.chmod(0o555)

    yield place, lock
    if mounted:
        subprocess.run(["umount", place], check=True)
    else:
        for path in folders():
            path.chmod(0o755)


def test_a_disk_that_is_really_full(folder, small_disk):
    store = Store.open(small_disk / "store")
    result = run_sync(chain(folder, keep="always", factor=1 / 3), store, keep_going=True)
    assert any("the disk is full" in error for error in result.errors)
    for outcome in result.outcomes.values():
        assert outcome.ref is None or store.inspect(outcome.ref.digest)[0] == "complete"


def test_a_read_only_store_serves_hits_and_says_what_to_do(folder, read_only):
    place, lock = read_only
    store = Store.open(place / "store")
    graph = chain(folder).upstream(["rig"])
    run_sync(graph, store)
    lock()
    result = run_sync(graph, Store.open(store.path))
    assert (result.counts["hit"], result.folder) == (7, None)
    assert result.product("rig").attrs["mean"] == 3.5
    with pytest.raises(StoreError, match=r"cannot be written \(.*\); get write access, or name another") as caught:
        run_sync(chain(folder), store)
    assert "nothing that was stored is lost" in str(caught.value)


def test_a_new_store_in_a_read_only_place(read_only):
    place, lock = read_only
    lock()
    with pytest.raises(StoreError, match="cannot be written"):
        Store.open(place / "store")
