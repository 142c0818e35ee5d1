"""What gc and verify print."""

import os
import time

import pytest
from denied import deny
from small import dicflow
from toys import chain, run_sync

from dicflow.engine.housekeeping import collect


@pytest.fixture
def old(folder, store):
    """A store whose two runs ended long ago."""
    for factor in (2.0, 3.0):
        run_sync(chain(folder, keep="always", factor=factor), store)
    then = time.time() - 7200
    for path in store.path.rglob("*"):
        os.utime(path, (then, then))
    return store


def files(store):
    return {path for path in store.path.rglob("*") if not path.is_dir()}


def test_gc_lists_exactly_what_it_then_deletes(old, tmp_path):
    (old.path / "quarantine").symlink_to(tmp_path / "numbers")
    (old.path / "tmp" / "\x1b]0;owned\a").touch()
    before = files(old)
    shown = dicflow("gc", old.path, "--keep-runs", 1)
    *listed, summary = shown.out.splitlines()
    assert summary.startswith("would free 0.")
    assert "12 products, 17 records, 1 runs, 0 definitions, 0 left by killed processes, 0 set aside" in summary
    assert {line.partition("  ")[0] for line in listed} == {"manifest", "group", "record", "run"}
    assert shown.err.splitlines() == [
        "left alone, since the store did not make it: quarantine",
        r"left alone, since the store did not make it: tmp/\u001b]0;owned\u0007",
    ]
    done = dicflow("gc", old.path, "--keep-runs", 1, "--delete")
    assert done.out.startswith("freed 0.")
    gone = {path.relative_to(old.path) for path in before - files(old)}
    named = [line.partition("  ")[2] for line in listed]
    assert all(any(path.is_relative_to(name) for name in named) for path in gone)
    assert not [name for name in named if (old.path / name).exists()]
    assert len(list((tmp_path / "numbers").iterdir())) == 6


def test_verify_tells_damaged_from_unreadable_and_foreign(old, monkeypatch):
    damaged, hidden = sorted(old.path.glob("actions/*/*.json"))[:2]
    damaged.write_bytes(damaged.read_bytes()[:-1])
    (old.path / "notes.txt").touch()
    deny(monkeypatch, hidden)
    found = dicflow("verify", old.path)
    assert found.code == 1
    assert found.out.splitlines()[-1] == "1 damaged; add --repair; 1 cannot be read; get read access"
    assert "notes.txt: is not part of the store" in found.out
    repaired = dicflow("verify", old.path, "--repair")
    assert repaired.out.splitlines()[-1] == "1 damaged, 1 of them set aside; 1 cannot be read; get read access"
    monkeypatch.undo()
    assert dicflow("verify", old.path).code == 0
    assert dicflow("verify", old.path).out.splitlines()[-1] == "nothing is damaged"
    assert hidden.exists()


def test_a_store_with_a_damaged_mark_is_verified_and_never_cleared(old):
    old.mark.write_bytes(b"\0" * 12)
    for command in ("gc", "pin"):
        dicflow(command, old.path).refuses(2, "dicflow.json: is damaged", "verify", "--repair")
    assert "dicflow.json: is damaged" in dicflow("verify", old.path).out
    assert dicflow("verify", old.path, "--repair").code == 1
    assert dicflow("verify", old.path).code == 0
    assert collect(old).found == []
