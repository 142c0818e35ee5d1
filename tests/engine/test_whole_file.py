"""Files that are written as a whole."""

import os
from pathlib import Path

import pytest

import dicflow
from dicflow.engine.whole_file import read_file, write_file
from tests.replaced import replace_here

PACKAGE = Path(dicflow.__file__).parent


def test_a_file_is_written_and_replaced(tmp_path):
    path = tmp_path / "a.json"
    write_file(path, b"one")
    write_file(path, b"two")
    assert path.read_bytes() == b"two"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_failure_leaves_the_file_and_no_draft(tmp_path, monkeypatch, failure):
    path = tmp_path / "a.json"
    path.write_bytes(b"one")

    def failing(*_):
        raise failure

    replace_here(monkeypatch, os, "replace", failing)
    with pytest.raises(type(failure)):
        write_file(path, b"two")
    assert path.read_bytes() == b"one"
    assert list(tmp_path.iterdir()) == [path]


def test_the_draft_is_where_the_caller_puts_it(tmp_path, monkeypatch):
    moved = []
    replace_here(monkeypatch, os, "replace", lambda *names: moved.append(names))
    write_file(tmp_path / "a.json", b"one", tmp_path / "draft")
    assert moved == [(tmp_path / "draft", tmp_path / "a.json")]


def test_what_must_outlast_a_power_failure_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    done = []
    fsync, replace = os.fsync, os.replace
    replace_here(monkeypatch, os, "fsync", lambda descriptor: done.append("fsync") or fsync(descriptor))
    replace_here(monkeypatch, os, "replace", lambda *names: done.append("replace") or replace(*names))
    write_file(tmp_path / "a.json", b"one")
    write_file(tmp_path / "a.json", b"two", durable=True)
    assert done == ["replace", "fsync", "replace", "fsync"]
    assert read_file(tmp_path / "a.json") == b"two"


def test_no_other_module_replaces_single_files():
    """``io/files.py`` moves a folder of finished exports."""
    users = {path.name for path in PACKAGE.rglob("*.py") if "os.replace(" in path.read_text(encoding="utf-8")}
    assert users == {"whole_file.py", "files.py"}
