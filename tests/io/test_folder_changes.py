"""Folders in which files come and go."""

from __future__ import annotations

import pytest

from dicflow.io.folder_changes import FolderChanges


@pytest.fixture
def folder(tmp_path):
    """A folder whose name begins as that of the store beside it."""
    (tmp_path / "run_photographs").mkdir()
    return tmp_path / "run_photographs"


def is_noticed(changes, path):
    """Whether a file that is written again and again is noticed, within two minutes."""
    for number in range(1200):
        path.write_text(f"{number}")
        if changes.wait(0.1):
            return True
    return False


def is_left_alone(changes, path):
    """Whether a file that is written is not noticed; news of what was written before may come late."""
    for number in range(10):
        while changes.wait(0.3):
            pass
        path.write_text(f"{number}")
        if not changes.wait(0.3):
            return True
    return False


def test_a_folder_whose_name_begins_as_that_of_the_store_is_watched(folder, tmp_path):
    with FolderChanges([folder], tmp_path / "run") as changes:
        assert is_noticed(changes, folder / "a.png")


def test_what_happens_in_a_store_below_does_not_count(folder):
    (folder / "store").mkdir()
    with FolderChanges([folder], folder / "store") as changes:
        assert is_noticed(changes, folder / "a.png")
        assert is_left_alone(changes, folder / "store" / "b")


def test_a_change_just_after_the_time_is_up_is_for_the_next_call(folder, tmp_path, monkeypatch):
    changes = FolderChanges([folder], tmp_path / "run")

    def late(seconds):
        changes._changed.set()
        return False

    with monkeypatch.context() as patch:
        patch.setattr(changes._changed, "wait", late)
        assert not changes.wait(0.0)
    assert changes.wait(0.0)


def test_missing_folders_are_listed(folder, tmp_path):
    assert FolderChanges([folder, tmp_path / "none"], tmp_path / "run").missing() == [tmp_path / "none"]
