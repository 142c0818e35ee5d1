"""What verify finds, names and repairs."""

import json
import os
import shutil

import pytest
import toys
from denied import deny
from test_execute import index
from toys import chain, run_sync

from dicflow.engine.hashing import digest_json
from dicflow.engine.housekeeping import collect, pin
from dicflow.engine.journal import find_run, latest
from dicflow.engine.layout import survey
from dicflow.engine.references import cache
from dicflow.engine.store import Store
from dicflow.engine.stored_json import read_stored
from dicflow.engine.verification import verify
from dicflow.errors import StoreError
from tests.replaced import replace_below

pytestmark = pytest.mark.slow


@pytest.fixture
def made(folder, store):
    """One run with a file of every sort in its store."""
    result = run_sync(chain(folder, keep="always"), store)
    pin(store, result.run_id, "as published")
    return result


FILES = {
    "mark": "dicflow.json",
    "files": "files.index",
    "actions": "actions.index",
    "pins": "pins.json",
    "manifest": "objects/*/*.json",
    "record": "actions/*/*.json",
    "code": "code/*.json",
    "latest": "runs/latest/*.json",
    "pipeline": "runs/2*/pipeline.json",
    "index": "runs/2*/index.json",
    "result": "runs/2*/result.json",
    "journal": "runs/2*/journal.jsonl",
    "group": "objects/*/*/zarr.json",
    "array": "objects/*/*/values/zarr.json",
    "chunk": "objects/*/*/values/c.0",
}
"""A file of each sort."""


def one(store, sort):
    return min(store.path.glob(FILES[sort]))


def test_these_are_all_sorts_of_files(store, made):
    listed = {path for pattern in FILES.values() for path in store.path.glob(pattern)}
    assert listed == {path for path in store.path.rglob("*") if path.is_file()}
    assert {found.part for found in survey(store.path).parts} == {
        "mark", "files", "actions", "pins", "manifest", "group", "record", "code", "run", "latest",
    }  # fmt: skip


def states(store):
    return [damage.state for damage in verify(store)]


@pytest.mark.parametrize("sort", FILES)
def test_no_flipped_bit_passes(store, made, sort):
    """In the first and last bytes, and in some between them."""
    path = one(store, sort)
    sound = path.read_bytes()
    places = {*range(12), *range(12, len(sound), max(len(sound) // 12, 1)), len(sound) - 2}
    for place in sorted(places):
        bit = 1 << place % 8
        path.write_bytes(sound[:place] + bytes([sound[place] ^ bit]) + sound[place + 1 :])
        assert states(store) == ["damaged"], place
    path.write_bytes(sound)
    assert verify(store) == []


DAMAGES = {
    "empty": b"",
    "zeros": b"\0" * 700,
    "deep": b"[" * 100_000 + b"\n",
    "number": b'{"a":5}\n',
    "not unicode": b"\xff\xfe\xfd\n",
    "endless": lambda path: path.touch() or os.truncate(path, 1 << 40),
    "a pipe": os.mkfifo,
    "a folder": os.mkdir,
}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("sort", FILES)
def test_any_other_contents_are_damage_and_the_next_run_ends_well(folder, store, made, sort, damage):
    path, content = one(store, sort), DAMAGES[damage]
    path.unlink()
    path.write_bytes(content) if isinstance(content, bytes) else content(path)
    is_allowed = damage == "empty" and sort in ("journal", "actions")
    assert states(store) == ["damaged"] * (not is_allowed)
    cache.clear()
    again = run_sync(chain(folder, keep="always"), Store.open(store.path))
    assert (again.ok, index(again)) == (True, index(made))
    assert list(again.product("total/step_06")["values"]) == [10.0] * 10
    verify(Store.open(store.path), repair=True)
    left = [found.reason for found in verify(store)]
    assert len(left) == (sort == "pins")


@pytest.mark.parametrize("sort", sorted(set(FILES) - {"journal", "actions"}))
def test_repair_makes_the_store_whole(folder, store, made, sort):
    path = one(store, sort)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(content)
    found = verify(Store.open(store.path, create=False, accept_damaged=True), repair=True)
    assert [damage.repaired for damage in found] == [sort != "pins"]
    if sort == "pins":
        with pytest.raises(StoreError, match="so what is pinned is unknown; restore it from a copy, or delete it"):
            collect(store)
        path.unlink()
    assert verify(store) == []
    again = run_sync(chain(folder, keep="always"), store)
    assert (again.ok, index(again)) == (True, index(made))


def test_lines_that_are_damaged_are_left_out_by_repair(store, made):
    entries = dict(made_index := find_run(store).index)
    for sort in ("journal", "actions"):
        path = one(store, sort)
        lines = path.read_bytes().splitlines(keepends=True)
        path.write_bytes(b"".join([lines[0], b"x" + lines[1][1:], *lines[2:]]))
        assert [(damage.state, "1 damaged lines" in damage.reason) for damage in verify(store)] == [("damaged", True)]
        verify(store, repair=True)
        assert path.read_bytes() == b"".join([lines[0], *lines[2:]])
    assert find_run(store).index == entries == made_index


def test_the_journal_of_a_run_in_progress_is_left_alone(store, made):
    path = one(store, "journal")
    one(store, "result").unlink()
    path.write_bytes(path.read_bytes() + b'{"crc32":"00')
    assert verify(store) == []
    content = b"x" + path.read_bytes()[1:]
    path.write_bytes(content)
    assert [damage.repaired for damage in verify(store, repair=True)] == [False]
    assert path.read_bytes() == content


def test_what_cannot_be_read_is_not_called_damaged(store, made, monkeypatch):
    """And repair leaves it where it is."""
    paths = {sort: one(store, sort) for sort in FILES if sort != "mark"}
    for sort, hidden in paths.items():
        with monkeypatch.context() as patched:
            deny(patched, hidden)
            found = verify(store, repair=True)
        assert [damage.state for damage in found] == ["unreadable"], sort
        assert "cannot be read (permission denied)" in found[0].reason
        assert hidden.exists()


def test_a_folder_that_cannot_be_listed_is_not_damaged(store, made, monkeypatch):
    def denied(path):
        raise PermissionError(13, "Permission denied", path)

    replace_below(monkeypatch, store.path / "code", os, "scandir", denied)
    assert [(damage.what, damage.state) for damage in verify(store, repair=True)] == [("code", "unreadable")]


def test_foreign_files_are_named_and_no_damage(store, made):
    (store.path / "objects" / "notes.txt").touch()
    (store.path / "linked").symlink_to(store.path)
    found = verify(store, repair=True)
    assert {(damage.what, damage.state) for damage in found} == {
        ("objects/notes.txt", "foreign"),
        ("linked", "foreign"),
    }
    assert (store.path / "objects" / "notes.txt").exists()


@pytest.mark.parametrize(
    ("old", "new"), [('"mm"', '"lm"'), ("some values", "sume values"), ("[10]", "[11]"), ("c32c", "c32d")]
)
def test_a_changed_description_of_an_array_is_found(store, made, old, new):
    """xarray would show it, though dicflow does not read it."""
    path = one(store, "array")
    path.write_text(path.read_text().replace(old, new))
    assert states(store) == ["damaged"]


def test_the_order_of_attributes_does_not_matter(store, made):
    """Two processes may have stored a product with its attributes in another order."""
    path = one(store, "group")
    found = json.loads(path.read_bytes())
    found["attributes"] = dict(reversed(found["attributes"].items()))
    path.write_text(json.dumps(found, separators=(",", ":")))
    assert verify(store) == []


@pytest.mark.parametrize(
    "forged",
    [
        {"dtype": "strange"},
        {"dtype": "|O"},
        {"dtype": "|S99999999"},
        {"dtype": "|f1"},
        {"shape": [10**12]},
        {"shape": [10**30, 0]},
        {"shape": [1] * 99, "dims": ["row"] * 99},
        {"dims": []},
    ],
)
def test_a_forged_description_with_the_right_digest_is_damage(store, made, forged):
    """Whoever writes into a store can renew every sum, but no description can fill the memory or break a command."""
    path = next(path for path in sorted(store.path.glob(FILES["manifest"])) if '"values"' in path.read_text())
    manifest = read_stored(path, lambda value: True)
    manifest["content"]["variables"]["values"] |= forged
    manifest["digest"] = digest_json(manifest["content"])
    place = store.manifest_path(manifest["digest"])
    store.write_json(place, manifest)
    assert [damage.what for damage in verify(store)] == [manifest["digest"]]
    assert store.inspect(manifest["digest"])[0] == "damaged"


def test_a_manifest_that_lists_no_files_of_its_arrays_is_damage(store, made):
    """Their values would be read as 0."""
    path = one(store, "chunk").parents[1].with_suffix(".json")
    store.write_json(path, read_stored(path, lambda value: True) | {"files": {}})
    assert states(store) == ["damaged"]


def test_a_further_part_of_an_array_is_found(store, made):
    """zarr would read it."""
    chunk = one(store, "chunk")
    shutil.copy(chunk, chunk.with_name("c.1"))
    assert states(store) == ["damaged"]


def test_files_in_the_place_of_others_are_found(store, made):
    for part in ("objects", "actions"):
        first, second = sorted((store.path / part).glob("*/*.json"))[:2]
        sound = first.read_bytes()
        first.write_bytes(second.read_bytes())
        assert states(store) == ["damaged"]
        first.write_bytes(sound)


def test_a_record_whose_parts_do_not_give_its_key_is_found(store, made):
    toys.edit_json(
        one(store, "record"), parts={**store.record(made.outcomes["report"].key).parts, "files": {}, "stage": "x"}
    )
    assert states(store) == ["damaged"]


def test_stores_without_check_sums_are_sound(folder, store, made):
    """An earlier release wrote none; nothing is made again for that."""
    for path in store.path.rglob("*.json*"):
        path.write_bytes(
            b"\n".join(b"{" + line[20:] if line[2:7] == b"crc32" else line for line in path.read_bytes().split(b"\n"))
        )
        assert b'crc32":' not in path.read_bytes()
    assert verify(store) == []
    opened = Store.open(store.path)
    assert run_sync(chain(folder, keep="always"), opened).counts["hit"] == 24
    assert latest(opened, "toys")
