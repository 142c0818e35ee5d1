"""Stores are compared by the digests of their arrays; a difference in attributes alone is not an error."""

from __future__ import annotations

import json

import numpy as np
import pytest

from dicflow.engine.journal import Event, Journal
from dicflow.engine.objects import describe
from dicflow.engine.product import Product, Variable
from dicflow.engine.store import Store
from tests.compare_stores import Difference, compare, main, newest_run, read_store, run_digests


def array(digest, units="mm"):
    return {"digest": digest, "dims": ["row"], "units": units, "long_name": "values"}


def product(kind="field", attrs=None, **arrays):
    return {"kind": kind, "attrs": attrs or {}, "variables": arrays}


def written(folder, values, **attrs):
    """A store with one run of two tasks, written by dicflow."""
    store = Store.open(folder)
    journal = Journal(store, "example", {})
    entries = {}
    for task, number in values.items():
        made = Product("field", {"U": Variable(("row",), np.full(3, number, float), "mm", "values")}, attrs)
        manifest = store.put(made, describe(made), keep=True)
        entries[task] = {"key": "sha256:" + "0" * 64, "digest": manifest.digest}
        journal.write(Event("finished", task=task, stage="s", status="computed", **entries[task]))
    journal.close(entries, {})
    return folder


def test_each_difference_has_its_task_and_name():
    a = {"s/1": product(U=array("a"), V=array("b")), "s/2": product(attrs={"n": 1}, U=array("a")), "s/3": product()}
    b = {"s/1": product(U=array("c"), W=array("b")), "s/2": product(attrs={"n": 2}, U=array("a", "px"))}
    assert compare(a, b) == [
        Difference("task", "only in A", "s/3"),
        Difference("array", "differs", "s/1", "U"),
        Difference("array", "only in A", "s/1", "V"),
        Difference("array", "only in B", "s/1", "W"),
        Difference("attribute", "differs", "s/2", "U.units"),
        Difference("attribute", "differs", "s/2", "n"),
    ]


def test_another_kind_differs():
    assert compare({"s": product("rig")}, {"s": product("total")}) == [
        Difference("attribute", "differs", "s", "(kind)")
    ]


@pytest.mark.parametrize(
    ("values", "attrs", "code", "line"),
    [
        ({"s/1": 1, "s/2": 2}, {"n": 1}, 0, "0 tasks or arrays and 0 attributes differ"),
        ({"s/1": 1, "s/2": 2}, {"n": 2}, 0, "differs: attribute s.n; tasks: s/1, s/2"),
        ({"s/1": 1, "s/2": 3}, {"n": 1}, 1, "differs: array s.U; tasks: s/2"),
        ({"s/1": 1}, {"n": 1}, 1, "only in A: task s; tasks: s/2"),
    ],
)
def test_stores_of_this_release(tmp_path, capsys, values, attrs, code, line):
    a = written(tmp_path / "a", {"s/1": 1, "s/2": 2}, n=1)
    b = written(tmp_path / "b", values, **attrs)
    assert main([str(a), str(b)]) == code
    assert line in capsys.readouterr().out.splitlines()


def test_the_newest_run_counts(tmp_path):
    for name, started in (("20250101-000000-aaaaaa", 5.0), ("20250101-000000-bbbbbb", 4.0)):
        run = tmp_path / "runs" / name
        run.mkdir(parents=True)
        (run / "pipeline.json").write_text(json.dumps({"started": started}))
    assert newest_run(tmp_path).name == "20250101-000000-aaaaaa"


def test_a_run_without_an_index_is_read_from_its_journal(tmp_path):
    event = {"kind": "finished", "task": "s/1", "digest": "sha256:ab"}
    failed = {"kind": "finished", "task": "s/2", "status": "failed"}
    (tmp_path / "journal.jsonl").write_text(f'{json.dumps(event)}\n{json.dumps(failed)}\n{{"kind": "fini')
    assert run_digests(tmp_path) == {"s/1": "sha256:ab"}


def test_a_store_that_cannot_be_read_gives_2(tmp_path):
    store = written(tmp_path / "a", {"s/1": 1})
    assert main([str(store), str(tmp_path / "nothing")]) == 2
    manifest = next(store.glob("objects/*/*.json"))
    manifest.unlink()
    assert main([str(store), str(store)]) == 2


def test_a_run_without_finished_tasks_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no finished task"):
        read_store(written(tmp_path / "a", {}))
