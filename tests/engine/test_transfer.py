"""Copies of runs between stores: complete, whole, and never believed."""

import shutil

import pytest
from toys import chain, edit_json, numbers, run_sync

from dicflow.engine.hashing import digest_json
from dicflow.engine.journal import find_run, runs
from dicflow.engine.store import Store
from dicflow.engine.stored_json import anything, read_stored
from dicflow.engine.transfer import Folder, pull, push
from dicflow.engine.verification import verify
from dicflow.errors import StoreError

TASKS = 24


class Memory:
    """A bucket in memory."""

    name = "s3://memory"

    def __init__(self):
        self.objects, self.written = {}, []

    def get(self, path, most):
        if path not in self.objects:
            raise FileNotFoundError(path)
        assert len(self.objects[path]) <= most
        return self.objects[path]

    def put(self, path, content):
        self.objects[path] = content
        self.written.append(path)

    def sizes(self, folder):
        return {path: len(content) for path, content in self.objects.items() if path.startswith(f"{folder}/")}


@pytest.fixture
def measured(folder, store):
    """A store with a run of which every product is kept."""
    run_sync(chain(folder, keep="always"), store)
    return store


@pytest.fixture
def other(tmp_path):
    return Store.open(tmp_path / "other")


def products(store):
    """How many different products the last run has."""
    return len({entry["digest"] for entry in find_run(store).index.values()})


def arrays(store):
    return sorted(path for path in (store.path / "objects").rglob("c*") if path.is_file())


@pytest.mark.parametrize("keep", ["always", "never"])
def test_a_run_pushed_and_pulled_is_all_hits_elsewhere(tmp_path, folder, store, other, keep):
    run_sync(chain(folder, keep=keep), store)
    bucket, seen = Memory(), []
    pushed = push(store, bucket, on_product=lambda done, total, task: seen.append((done, total)))
    assert (pushed.products, seen[-1]) == (TASKS, (TASKS, TASKS))
    assert pushed.nbytes == sum(
        len(content) for path, content in bucket.objects.items() if path.startswith(("objects", "actions", "code"))
    )
    pulled = pull(other, bucket)
    assert (pulled.run, pulled.products) == (pushed.run, TASKS)
    assert verify(other) == []
    copied = numbers(tmp_path / "elsewhere")
    assert run_sync(chain(copied, keep=keep), other).counts == {"hit": TASKS, "computed": 0, "failed": 0, "skipped": 0}
    ours, theirs = find_run(store), find_run(other, pushed.run)
    assert theirs.index == ours.index
    assert list(theirs.events()) == list(ours.events())
    assert theirs.result == ours.result


def test_what_is_there_is_copied_only_once(measured, other):
    bucket = Memory()
    first = push(measured, bucket)
    bucket.written.clear()
    assert push(measured, bucket)[2:] == (0, 0)
    assert not [path for path in bucket.written if path.startswith(("objects", "actions", "code"))]
    assert pull(other, bucket).new == products(measured)
    assert pull(other, bucket)[1:] == (first.products, 0, 0)
    assert len(runs(other)) == 1


def test_a_push_that_was_cut_short_is_completed(measured, other):
    """The index, which makes a run known, comes last, and a manifest after its arrays."""
    bucket = Memory()
    push(measured, bucket)
    order = bucket.written
    assert order[-1].endswith("/index.json")
    for path in bucket.objects:
        if path.startswith("objects") and path.count("/") > 2:
            manifest = "/".join(path.split("/")[:3]) + ".json"
            assert order.index(path) < order.index(manifest)
    for path in order[len(order) // 2 :]:
        bucket.objects.pop(path)
    with pytest.raises(StoreError, match="has no run 'latest'; its runs: none"):
        pull(other, bucket)
    push(measured, bucket)
    assert pull(other, bucket).new == products(measured)


def test_runs_are_chosen_by_name(folder, measured, other):
    old = find_run(measured).id
    for factor in (3.0, 4.0, 5.0):  # in the same second
        run_sync(chain(folder, keep="always", factor=factor), measured)
    pull(other, Folder(measured.path), old)
    assert [run.id for run in runs(other)] == [old]
    assert pull(other, Folder(measured.path)).run == find_run(measured).id
    with pytest.raises(StoreError, match=f"has no run 'that'; its runs: .*{old}"):
        pull(other, Folder(measured.path), "that")


def test_what_the_store_has_stays(folder, measured, other):
    """A record from elsewhere never takes the place of one that was measured here."""
    run_sync(chain(folder, keep="always"), other)
    before = {path: path.read_bytes() for path in (other.path / "actions").rglob("*.json")}
    for path in (measured.path / "actions").rglob("*.json"):
        edit_json(path, made={**read_stored(path, anything)["made"], "host": "elsewhere"})
    pull(other, Folder(measured.path))
    assert {path: path.read_bytes() for path in before} == before


def damaged_array(store):
    path = arrays(store)[0]
    content = bytearray(path.read_bytes())
    content[-6] ^= 1
    path.write_bytes(content)


def shorter_array(store):
    arrays(store)[0].write_bytes(b"")


def larger_array(store):
    arrays(store)[0].write_bytes(bytes(10_000_000))


def missing_array(store):
    arrays(store)[0].unlink()


def pipe_for_an_array(store):
    import os

    path = arrays(store)[0]
    path.unlink()
    os.mkfifo(path)


def exchanged_manifests(store):
    first, second, *_ = sorted((store.path / "objects").rglob("??????*.json"))
    shutil.copy(first, second)


def other_values(store):
    """The arrays and the manifest of another product, under the name of this one."""
    path = next(path for path in sorted((store.path / "objects").glob("*/*.json")) if path.with_suffix("").is_dir())
    edit_json(path, content={**read_stored(path, anything)["content"], "attrs": {"mine": 1}})


def strange_file(store):
    path = next(path for path in sorted((store.path / "objects").glob("*/*.json")) if path.with_suffix("").is_dir())
    edit_json(path, files={**read_stored(path, anything)["files"], "run.py": 3})
    (path.with_suffix("") / "run.py").write_text("1/0")


def other_record(store):
    first, second, *_ = sorted((store.path / "actions").rglob("*.json"))
    shutil.copy(first, second)


def other_parts(store):
    """A record that says its product came from other parameters than its key."""
    path = next(iter(sorted((store.path / "actions").rglob("*.json"))))
    parts = read_stored(path, anything)["parts"]
    edit_json(path, parts={**parts, "parameters": {"forged": True}})


def link_out(store):
    folder = next(path for path in sorted((store.path / "objects").iterdir()))
    outside = store.path.parent / "outside"
    shutil.move(folder, outside)
    folder.symlink_to(outside)


def cut_record(store):
    path = next(iter(sorted((store.path / "actions").rglob("*.json"))))
    path.write_bytes(path.read_bytes()[:-1])


DAMAGES = [
    damaged_array, shorter_array, larger_array, missing_array, pipe_for_an_array, exchanged_manifests, other_values,
    strange_file, other_record, other_parts, link_out, cut_record,
]  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_is_one_sentence_and_nothing_of_it_arrives(measured, other, damage):
    damage(measured)
    with pytest.raises(StoreError) as caught:
        pull(other, Folder(measured.path))
    message = str(caught.value)
    assert str(measured.path) in message
    assert message.endswith("; copy it again from where it is whole")
    assert message.count("\n") == 0
    assert verify(other) == []
    assert runs(other) == []
    assert not list((other.path / "tmp").iterdir())
    assert not list(other.path.rglob("*.py"))


@pytest.mark.parametrize("damage", [damaged_array, missing_array, cut_record])
def test_damage_here_is_not_pushed(measured, damage):
    damage(measured)
    bucket = Memory()
    with pytest.raises(StoreError, match="run the pipeline again"):
        push(measured, bucket)
    assert not bucket.sizes("runs")


@pytest.mark.parametrize("name", ["../../../escaped", "a/b", "/etc/cron.d/x", "c:x", ""])
def test_names_of_arrays_lead_nowhere(tmp_path, measured, other, name):
    """Also where manifest, digest and index agree with one another."""
    run = find_run(measured)
    task, entry = next(item for item in run.index.items() if measured.object_path(item[1]["digest"]).is_dir())
    manifest = read_stored(measured.manifest_path(entry["digest"]), anything)
    content = {**manifest["content"], "variables": {name: manifest["content"]["variables"]["values"]}}
    digest, group = digest_json(content), measured.object_path(entry["digest"])
    files = {f"{name}/{file.partition('/')[2]}": size for file, size in manifest["files"].items() if "/" in file}
    forged = measured.manifest_path(digest)
    forged.parent.mkdir(exist_ok=True)
    forged.write_bytes(measured.manifest_path(entry["digest"]).read_bytes())
    edit_json(forged, digest=digest, content=content, files={"zarr.json": manifest["files"]["zarr.json"], **files})
    shutil.copytree(group, measured.object_path(digest))
    edit_json(run.folder / "index.json", **{task: {**entry, "digest": digest}})
    for line in ("journal.jsonl", "result.json"):
        (run.folder / line).write_bytes(b"")
    before = set(tmp_path.rglob("*"))
    with pytest.raises(StoreError):
        pull(other, Folder(measured.path))
    assert not [path for path in set(tmp_path.rglob("*")) - before if not path.is_relative_to(other.path)]


def test_an_index_cannot_name_paths(measured, other):
    run = find_run(measured)
    edit_json(run.folder / "index.json", evil={"key": "sha256:../../x", "digest": "sha256:../../x"})
    with pytest.raises(StoreError, match="holds something else than it should"):
        pull(other, Folder(measured.path))


def test_what_is_no_store_is_refused(tmp_path, measured, other):
    with pytest.raises(StoreError, match="is not a store; name a folder or bucket that a run was pushed to"):
        pull(other, Folder(tmp_path / "nothing"))
    edit_json(measured.mark, format=1)
    with pytest.raises(StoreError, match="has format 1, this release reads 2"):
        pull(other, Folder(measured.path))
