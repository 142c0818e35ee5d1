"""Files that appear together or not at all."""

from __future__ import annotations

import os

import pytest

from dicflow.errors import ConfigurationError, InputError
from dicflow.io.files import staged


def export(output, *names, error=None, force=False):
    with staged(output, force) as folder:
        for name in names:
            (folder / name).write_text(name)
        if error is not None:
            raise error


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_all_files_appear(tmp_path):
    with staged(tmp_path / "a" / "b") as folder:
        (folder / "one").write_text("1")
        (folder / "two").write_text("2")
        assert [path for path in (tmp_path / "a" / "b").iterdir()] == [folder]
    assert contents(tmp_path / "a" / "b") == {"one": b"1", "two": b"2"}


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError, InputError("no"), OSError("disk full")])
def test_a_failure_leaves_all_as_it_was(error, tmp_path):
    (tmp_path / "one").write_text("mine")
    with pytest.raises((KeyboardInterrupt, ZeroDivisionError, InputError)):
        export(tmp_path, "one", error=error, force=True)
    assert contents(tmp_path) == {"one": b"mine"}


def test_folders_that_a_failed_export_made_are_taken_away(tmp_path):
    with pytest.raises(ZeroDivisionError):
        export(tmp_path / "a" / "b", "one", error=ZeroDivisionError)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten_without_force(tmp_path):
    (tmp_path / "two").write_text("mine")
    with pytest.raises(ConfigurationError, match="two exists; add --force"):
        export(tmp_path, "one", "two")
    assert contents(tmp_path) == {"two": b"mine"}
    export(tmp_path, "two", force=True)
    assert contents(tmp_path) == {"two": b"two"}


def test_a_folder_in_the_place_of_a_file(tmp_path):
    (tmp_path / "one").mkdir()
    with pytest.raises(InputError, match=r"one: .*a folder has this name"):
        export(tmp_path, "one", force=True)


def test_an_output_that_cannot_be(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="a file stands where a folder should be"):
        export(tmp_path / "file", "one")
    assert os.listdir(tmp_path) == ["file"]
