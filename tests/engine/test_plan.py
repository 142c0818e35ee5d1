import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, Literal

import pytest
import toys
from toys import StageSpec, chain, expand, run_sync, write

from dicflow.engine.fingerprint import Fingerprint
from dicflow.engine.journal import find_run
from dicflow.engine.node import At, Joined, Node, Port, Scope, parameter
from dicflow.engine.plan import code_changes, make_plan
from dicflow.errors import ConfigurationError, InputError
from tests.replaced import replace_below


def plan(graph, store, **options):
    return make_plan(graph, store, pipeline="toys", **options)


def reasons(graph, store, *names):
    entries = plan(graph, store).entries
    return [entries[name].reason for name in names]


def test_an_empty_store(folder, store):
    found = plan(chain(folder), store)
    assert found.counts == {"hit": 0, "run": 6, "pending": 18}
    assert found.by_stage()["scale"] == {"hit": 0, "run": 0, "pending": 6}
    assert found.entries["read/step_01"].reason == "not made before"
    assert found.entries["rig"].reason == "waits for read/step_01 and 5 more"
    assert found.entries["difference/step_02"].waits_for == ("scale/step_01", "scale/step_02")


class Picky(Node):
    """Names steps that must exist, and a number that the first file must not exceed."""

    title: ClassVar = "picky"
    scope: ClassVar = Scope.TEST
    takes: ClassVar = {"numbers": Port("number", at=At.ALL)}
    gives: ClassVar = "number"
    stage: Literal["picky"] = "picky"
    still: tuple[str, ...] = parameter(())
    most: float = parameter(9.0)

    def problems(self, joined: Mapping[str, Joined]) -> Iterator[tuple[str, str]]:
        """Unknown steps, and a first number that is too large."""
        if joined["numbers"].is_whole:
            yield from (("still", f"no {name}") for name in self.still if name not in joined["numbers"].steps)
        if joined["numbers"].facts["source"]["value"] > self.most:
            yield "most", "exceeded"

    def run(self, numbers):
        return numbers[0]


def picky(folder, **parameters):
    places = {"still": "p.yaml:7:5"}
    picky = StageSpec(Picky(**parameters), {"numbers": "read"}, folder, "p.yaml:5:3", places)
    return {"read": StageSpec(toys.Read(), {}, folder), "picky": picky}


def test_parameters_that_do_not_suit_the_files_are_listed_with_their_places(folder, store):
    stages = picky(folder, still=("step_01", "step_9", "x"), most=0.5)
    with pytest.raises(ConfigurationError) as caught:
        plan(expand(stages), store)
    assert str(caught.value).splitlines() == [
        "p.yaml:7:5: picky.still: no step_9",
        "p.yaml:7:5: picky.still: no x",
        "p.yaml:5:3: picky.most: exceeded",
    ]
    assert plan(expand(picky(folder, still=("step_01",))), store).counts["run"] == 6


def test_steps_that_may_still_come_are_not_missed(folder, store):
    stages = picky(folder, still=("step_09",))
    so_far = {"read": dict(list(toys.Read().steps(folder).items())[:3])}
    assert plan(expand(stages, so_far), store).counts["run"] == 3
    few = replace(stages["read"], only=("step_01", "step_02"))
    assert plan(expand({**stages, "read": few}), store).counts["run"] == 2
    with pytest.raises(ConfigurationError, match="most: exceeded"):
        plan(expand(picky(folder, most=0.5), so_far), store)


def test_a_changed_parameter_is_shown_old_and_new(folder, store):
    run_sync(chain(folder), store)
    found = plan(chain(folder, factor=3.0, length="3 cm"), store)
    assert found.entries["scale/step_02"].reason == "factor: 2.0 → 3.0; length: 20.0 → 30.0"
    assert [change.text for change in found.why("report")] == ["factor: 2.0 → 3.0", "length: 20.0 → 30.0"]
    assert found.entries["rig"].reason == "stored"


def test_a_changed_file_and_input_are_named(folder, store):
    run_sync(chain(folder), store)
    write(folder / "step_03.txt", "3.5")
    assert reasons(chain(folder), store, "read/step_03") == ["file source changed"]
    run_sync(chain(folder).upstream(["read"]), store)
    assert reasons(chain(folder), store, "scale/step_03") == ["waits for rig"]
    run_sync(chain(folder).upstream(["rig"]), store)
    assert reasons(chain(folder), store, "scale/step_03", "scale/step_01") == [
        "input number changed; input rig changed",
        "input rig changed",
    ]


def test_a_changed_version_is_shown(folder, store, monkeypatch):
    run_sync(chain(folder), store)
    monkeypatch.setattr(toys.Scale, "impl_version", 2)
    assert reasons(chain(folder), store, "scale/step_01") == ["impl_version: 1 → 2"]


def test_lost_and_damaged_products_and_records(folder, store):
    index = run_sync(chain(folder, keep="always"), store).store and find_run(store).index
    manifest = store.object_path(index["scale/step_01"]["digest"]).with_suffix(".json")
    manifest.unlink()
    manifest = store.object_path(index["scale/step_02"]["digest"]).with_suffix(".json")
    manifest.write_text("")
    store.record_path(index["scale/step_03"]["key"]).unlink()
    assert reasons(chain(folder, keep="always"), store, "scale/step_01", "scale/step_02", "scale/step_03") == [
        "the stored product is missing",
        "the stored product is damaged",
        "its record is no longer in the store",
    ]


@pytest.fixture
def edited(monkeypatch):
    """After this, the code of the function ``field`` of the toys is another: four stages of six use it."""
    from dicflow.engine import fingerprint

    original = fingerprint.code_of

    def change():
        def code_of(path, module):
            code = original(path, module)
            if module == "toys":
                code["definitions"]["field"][0] = "sha256:" + "0" * 64
            return code

        monkeypatch.setattr(fingerprint, "code_of", code_of)
        monkeypatch.setattr("dicflow.engine.files.FileIndex._remember", lambda *_: None)

    return change


@pytest.mark.parametrize(("policy", "hits", "warned"), [("recompute", 0, 0), ("warn", 24, 4), ("ignore", 24, 0)])
def test_edited_code_never_passes_in_silence_unless_told_so(folder, store, edited, policy, hits, warned):
    run_sync(chain(folder), store)
    edited()
    (store.path / "files.index").unlink()
    fresh = type(store).open(store.path)
    found = plan(chain(folder), fresh, code_policy=policy)
    assert (found.counts["hit"], len(found.warnings)) == (hits, warned)
    if policy == "recompute":
        assert found.entries["read/step_01"].reason == "code of toys:field changed"
    if policy == "warn":
        assert "scale: code of toys:field changed since its results were made; they are used" in found.warnings


@pytest.mark.parametrize("lost", ["code", "its form", "both"])
def test_code_that_is_not_known_any_more_is_other_code(folder, store, edited, lost):
    index = run_sync(chain(folder), store).store and find_run(store).index
    path = store.record_path(index["read/step_01"]["key"])
    code = store.record(index["read/step_01"]["key"]).code
    if lost != "its form":
        edited()
        (store.path / "files.index").unlink()
        store.code_path(code).unlink()
    if lost != "code":
        toys.edit_json(path, code={"toys": code})
    assert reasons(chain(folder), type(store).open(store.path), "read/step_01") == ["the code changed"]


def test_of_many_edited_definitions_five_are_named(folder, store):
    key = find_run(run_sync(chain(folder), store).store).index["read/step_01"]["key"]
    record, code = store.record(key), {f"m:{name}": "sha256:d" for name in "abcdefgh"}
    store.put_code("sha256:" + "0" * 64, code)
    other = Fingerprint("sha256:" + "1" * 64, {name: "sha256:e" for name in code})
    changes = code_changes(store, replace(record, code="sha256:" + "0" * 64), other)
    assert [change.name for change in changes] == [*list(code)[:5], "3 more definitions"]


def test_edited_code_is_told_of_once_when_the_hits_show_only_while_it_runs(folder, store, edited):
    index = run_sync(chain(folder), store).store and find_run(store).index
    store.object_path(index["read/step_01"]["digest"]).with_suffix(".json").unlink()
    edited()
    (store.path / "files.index").unlink()
    events = []
    fresh, options = type(store).open(store.path), {"code_policy": "warn", "on_event": events.append}
    result = run_sync(chain(folder), fresh, **options)
    assert result.counts == {"hit": 23, "computed": 1, "failed": 0, "skipped": 0}
    stages = ["difference", "read", "scale", "total"]
    assert sorted(text.partition(":")[0] for text in result.warnings) == stages
    assert sorted(event.text for event in events if event.kind == "warning") == sorted(result.warnings)


def test_files_are_checked_before_anything_runs(folder, store):
    write(folder / "step_04.txt", "four")
    with pytest.raises(InputError, match=r"step_04\.txt: holds no number; write one"):
        run_sync(chain(folder), store)
    write(folder / "step_04.txt", "4e9")
    with pytest.raises(InputError, match="too large beside the others"):
        run_sync(chain(folder), store)
    assert not (store.path / "objects").exists()


def test_files_are_held_against_the_steps_that_a_stage_takes(folder, store, monkeypatch):
    seen = []
    monkeypatch.setattr(toys.Scale, "agree", lambda _, *given: seen.append(given))
    table = folder / "step_01.txt"
    plan(chain(folder, table=str(table)), store)
    assert seen == [({table: {}}, {}, {"number": tuple(f"step_0{k}" for k in range(1, 7)), "rig": ()})]


def test_checked_files_are_not_opened_again(folder, store, monkeypatch):
    run_sync(chain(folder), store)
    replace_below(monkeypatch, folder, Path, "read_text", None)
    monkeypatch.setattr("dicflow.engine.files.digest_file", None)
    assert plan(chain(folder), type(store).open(store.path)).counts["hit"] == 24


def test_a_file_that_is_refused_costs_those_before_it_no_second_look(folder, store, monkeypatch):
    write(folder / "step_04.txt", "four")
    with pytest.raises(InputError):
        plan(chain(folder), store)
    seen, check = [], toys.Read.check
    monkeypatch.setattr(toys.Read, "check", lambda self, path: seen.append(path.stem) or check(self, path))
    write(folder / "step_04.txt", "4")
    plan(chain(folder), type(store).open(store.path))
    assert "step_04" in seen
    assert not {"step_01", "step_02", "step_03"} & set(seen)


def checking(folder, store):
    """The events that a plan sends: what is checked, how much is done, how much there is."""
    events = []
    plan(chain(folder), store, on_event=events.append)
    assert {event.kind for event in events} <= {"checking"}
    return [(event.text, event.counts["done"], event.counts["all"]) for event in events]


def test_a_large_plan_reports_what_it_has_checked(folder, store, monkeypatch):
    assert checking(folder, store) == []
    monkeypatch.setattr("dicflow.engine.plan._MANY", 0)
    monkeypatch.setattr("dicflow.engine.plan._MANY_FILES", 0)
    monkeypatch.setattr("dicflow.engine.plan._REPORTS", 3)
    files, tasks = [("files", done, 6) for done in (2, 4, 6)], [("tasks", done, 24) for done in (8, 16, 24)]
    assert checking(folder, store) == files + tasks


def test_touching_a_file_changes_nothing(folder, store):
    run_sync(chain(folder), store)
    os.utime(folder / "step_02.txt")
    assert plan(chain(folder), store).counts["hit"] == 24


def test_a_file_that_changes_while_it_is_planned_for_is_not_used(folder, store, monkeypatch):
    digest, changing = store.files.digest, folder / "step_04.txt"

    def slow(path):
        found = digest(path)
        if path == changing:
            write(changing, "44")
        return found

    monkeypatch.setattr(store.files, "digest", slow)
    assert "step_04.txt: changed during the run" in run_sync(chain(folder), store, keep_going=True).errors[0]
    monkeypatch.undo()
    assert run_sync(chain(folder), store).product("read/step_04")["values"][0] == 44.0


THOUSAND = """
import sys
from pathlib import Path
sys.path[:0] = sys.argv[3:]
from toys import chain, run_sync
from dicflow.engine.store import Store
graph, store = chain(Path(sys.argv[1])).upstream(["scale"]), Store.open(Path(sys.argv[2]))
result = run_sync(graph, store, scheduler="processes", dashboard=True)
loaded = {"dask", "distributed", "zarr", "numpy"} & set(sys.modules)
print(result.counts["hit"], len(result.outcomes), sorted(loaded))
"""


@pytest.mark.slow
def test_a_thousand_hits_start_no_cluster_and_load_no_numerics(tmp_path, store):
    folder = toys.numbers(tmp_path / "many", 500)
    graph = chain(folder).upstream(["scale"])
    assert len(graph.tasks) == 1001
    assert run_sync(graph, store).ok
    command = [sys.executable, "-c", THOUSAND, folder, store.path, str(Path(__file__).parent)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "1001 1001 []"
