import os

import pytest
from toys import write

from dicflow.engine.files import FACTS, FileIndex
from dicflow.engine.stored_json import read_stored, seal
from dicflow.errors import InputError


class Counted:
    """A fact that counts how often it is looked up."""

    def __init__(self):
        self.times = 0

    def __call__(self, path):
        self.times += 1
        return path.read_text()


@pytest.fixture
def file(tmp_path):
    write(tmp_path / "a.txt", "one")
    return tmp_path / "a.txt"


def test_an_unchanged_file_is_read_once(tmp_path, file):
    find = Counted()
    index = FileIndex(tmp_path / "index")
    assert [index.fact(file, "text", find) for _ in range(3)] == ["one"] * 3
    index.save()
    assert FileIndex(tmp_path / "index").fact(file, "text", find) == "one"
    assert find.times == 1


def test_a_changed_file_is_read_again(tmp_path, file):
    index = FileIndex(tmp_path / "index")
    first = index.digest(file)
    write(file, "two", age_s=30)
    assert index.digest(file) != first
    write(file, "one", age_s=20)
    assert index.digest(file) == first


def test_a_file_put_in_the_place_of_another_is_seen(tmp_path, file):
    """Same size and time, another inode."""
    index = FileIndex(tmp_path / "index")
    first = index.digest(file)
    write(tmp_path / "b.txt", "two")
    os.utime(tmp_path / "b.txt", ns=(file.stat().st_atime_ns, file.stat().st_mtime_ns))
    os.replace(tmp_path / "b.txt", file)
    assert index.digest(file) != first


def test_a_file_overwritten_in_place_that_keeps_size_and_time_is_seen(tmp_path, file):
    index = FileIndex(tmp_path / "index")
    before, first = file.stat(), index.digest(file)
    file.write_text("two")
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert (file.stat().st_ino, file.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    assert index.digest(file) != first


@pytest.mark.parametrize("age_s", [0, 60])
def test_a_file_written_just_now_is_not_trusted(tmp_path, file, monkeypatch, age_s):
    """It may change again within one tick of the clock, even if its time was set."""
    monkeypatch.setattr("dicflow.engine.files._FRESH_NS", 2_000_000_000)
    write(file, "one", age_s=age_s)
    find = Counted()
    index = FileIndex(tmp_path / "index")
    index.fact(file, "text", find)
    index.fact(file, "text", find)
    assert find.times == 2


def test_saving_keeps_what_others_saved(tmp_path, file):
    write(tmp_path / "b.txt", "b")
    one, other = FileIndex(tmp_path / "index"), FileIndex(tmp_path / "index")
    one.digest(file)
    other.digest(tmp_path / "b.txt")
    one.save()
    other.save()
    assert len(read_stored(tmp_path / "index", FACTS)) == 2


@pytest.mark.parametrize(
    "entry",
    [3, {"stamp": 1, "facts": {}}, {"stamp": [1], "facts": None}, {"stamp": [1]}, {"stamp": [True], "facts": {}}],
)
def test_an_index_with_an_entry_of_another_form_is_an_empty_one(tmp_path, file, entry):
    (tmp_path / "index").write_bytes(seal({str(file): entry}))
    assert FileIndex(tmp_path / "index").digest(file).startswith("sha256:")


def test_a_changed_fact_is_not_trusted(tmp_path, file):
    index = FileIndex(tmp_path / "index")
    index.fact(file, "width", lambda _: 720)
    index.save()
    content = (tmp_path / "index").read_bytes()
    (tmp_path / "index").write_bytes(content.replace(b"720", b"722"))
    assert FileIndex(tmp_path / "index").fact(file, "width", lambda _: 720) == 720


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir])
def test_what_is_no_regular_file_is_refused_and_never_waited_for(tmp_path, make):
    make(tmp_path / "x")
    with pytest.raises(InputError, match=r"x: cannot be read \(not a regular file\)"):
        FileIndex(tmp_path / "index").digest(tmp_path / "x")
    assert FileIndex(tmp_path / "x").path.exists()


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"gone\.txt: cannot be read \(no such file"):
        FileIndex(tmp_path / "index").digest(tmp_path / "gone.txt")


def test_an_index_that_cannot_be_saved_is_no_error(tmp_path, file):
    index = FileIndex(tmp_path / "no folder" / "index")
    index.digest(file)
    index.save()
