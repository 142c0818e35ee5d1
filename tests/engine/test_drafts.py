"""Whose drafts are left over."""

import os
import subprocess
import sys

import pytest
from test_housekeeping import aged

from dicflow.engine import drafts
from dicflow.engine.drafts import draft_name, is_abandoned
from dicflow.engine.housekeeping import collect
from tests.replaced import replace_here

HOUR, WEEK = 3600.0, 7 * 86400.0
GONE = "{machine}-{gone}-12345678"
ALIVE = "{machine}-{alive}-12345678"
ELSEWHERE = "00000000-{gone}-12345678"
OF_ANY_MACHINE = "{gone}-" + "a" * 32


@pytest.fixture(scope="module")
def gone():
    """Number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def left(store, name, gone, age_s):
    """A draft of a product, last changed so long ago."""
    machine = draft_name().partition("-")[0]
    path = store.path / "tmp" / name.format(machine=machine, gone=gone, alive=os.getpid())
    (path / "values").mkdir(parents=True)
    (path / "values" / "zarr.json").write_text("{}")
    aged(store.path, age_s)
    return path


@pytest.mark.parametrize(
    ("name", "age_s", "goes"),
    [
        (GONE, HOUR + 60, True),
        (GONE, HOUR - 60, False),
        (ALIVE, 10 * WEEK, False),
        (ELSEWHERE, WEEK - 60, False),
        (ELSEWHERE, WEEK + 60, True),
        (OF_ANY_MACHINE, WEEK - 60, False),
        (OF_ANY_MACHINE, WEEK + 60, True),
        ("left by me", 10 * WEEK, False),
    ],
)
def test_only_what_nobody_will_finish_goes(store, gone, name, age_s, goes):
    path = left(store, name, gone, age_s)
    assert [one.path for one in collect(store).found] == [path] * goes
    collect(store, delete=True)
    assert path.exists() != goes


def test_a_draft_that_is_still_written_is_young(store, gone):
    path = left(store, GONE, gone, 2 * HOUR)
    (path / "values" / "c.0").write_text("new")
    assert collect(store).found == []


def test_drafts_of_indexes_are_found_beside_them(store, gone):
    path = store.path / f"files.index.{gone}-12345678.part"
    path.touch()
    aged(store.path, WEEK + 60)
    assert [one.path for one in collect(store, delete=True).found] == [path]
    assert not path.exists()


def test_two_machines_of_one_name_are_two(monkeypatch):
    """Their identities tell them apart, and so does a container's own table of processes."""
    here = draft_name().partition("-")[0]
    replace_here(monkeypatch, os, "readlink", lambda _: b"pid:[1]")
    drafts._machine.cache_clear()
    assert draft_name().partition("-")[0] != here
    monkeypatch.undo()
    drafts._machine.cache_clear()
    assert draft_name().partition("-")[0] == here


@pytest.mark.parametrize("name", ["", "x", "1-2", "1-12345678.json", "../1-12345678", "1-1234567g"])
def test_other_names_are_no_drafts(tmp_path, name):
    assert not is_abandoned(tmp_path, name, 0.0)
