"""Files that appear together or not at all."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from dicflow.engine.drafts import draft_name
from dicflow.errors import ConfigurationError, InputError
from dicflow.io import files
from dicflow.io.files import staged, write_whole


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


KILLED = """
import os, signal, sys
from pathlib import Path
from dicflow.io.files import staged
with staged(Path(sys.argv[1])) as folder:
    (folder / "one").write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_killed_export_has_left_is_taken_away_by_the_next(tmp_path):
    """The folder of one that is still at work stays."""
    done = subprocess.run([sys.executable, "-c", KILLED, tmp_path])
    assert done.returncode == -signal.SIGKILL
    (left,) = tmp_path.iterdir()
    assert (left / "one").read_text() == "half"
    with staged(tmp_path) as other:
        assert list(tmp_path.iterdir()) == [other]
        export(tmp_path, "one")
        assert other.is_dir()
    assert contents(tmp_path) == {"one": b"one"}


def test_what_a_killed_writer_has_left_is_taken_away_by_the_next(tmp_path, monkeypatch):
    names = [f"page.html.{draft_name().replace(str(os.getpid()), process)}.part" for process in ("999999999", "1")]
    for name in [*names, "page.html.part", "notes.12345678.part"]:
        (tmp_path / name).write_text("half")
    (tmp_path / f"linked.{names[0]}").symlink_to(tmp_path / names[0])
    write_whole(tmp_path / "page.html", b"whole")
    assert {path.name for path in tmp_path.iterdir()} == {
        "page.html", names[1], "page.html.part", "notes.12345678.part", f"linked.{names[0]}",
    }  # fmt: skip
    monkeypatch.setattr(files, "_clear", None)
    write_whole(tmp_path / "page.html", b"looked at once for many files")
