import os
import shutil
import threading

import pytest
from test_execute import index
from toys import chain, run_sync

from dicflow.engine import plan as plans
from dicflow.engine.action_index import Action, ActionIndex
from dicflow.engine.fingerprint import Fingerprint
from dicflow.engine.housekeeping import collect
from dicflow.engine.journal import find_run
from dicflow.engine.plan import make_plan
from dicflow.engine.references import cache
from dicflow.engine.store import Store
from dicflow.engine.verification import verify
from dicflow.errors import DamagedError


@pytest.fixture(autouse=True)
def every_plan_is_large(monkeypatch):
    monkeypatch.setattr(plans, "_MANY", 0)


@pytest.fixture
def opened_records(monkeypatch):
    """Keys of the records that were opened."""
    keys, record = [], Store.record
    monkeypatch.setattr(Store, "record", lambda self, key: keys.append(key) or record(self, key))
    return keys


def action(number, form="a"):
    return Action(f"sha256:{number:064x}", form, f"sha256:{number + 1:064x}")


def key(number):
    return f"sha256:{number:064x}"


def lines(path):
    return path.read_bytes().splitlines(keepends=True)


@pytest.fixture
def three(tmp_path):
    """An index of three actions, one of each form."""
    made = ActionIndex(tmp_path / "index")
    made.append((key(n), action(n, form)) for n, form in enumerate("abr"))
    return made


@pytest.mark.parametrize("form", "abrABR")
def test_a_line_that_is_being_written_is_no_damage(tmp_path, form):
    made = ActionIndex(tmp_path / "index")
    made.append([(key(1), action(1, form))])
    line = made.path.read_bytes()
    for length in range(len(line)):
        made.path.write_bytes(line + line[:length])
        assert made.damaged_lines() == 0, length


def test_actions_come_back_and_the_last_line_of_a_key_counts(three):
    assert three.read() == {key(n): action(n, form) for n, form in enumerate("abr")}
    assert [one.kept for one in three.read().values()] == [True, True, False]
    three.append([(key(1), action(9))])
    assert three.read()[key(1)] == action(9)
    assert len(lines(three.path)) == 4


@pytest.mark.parametrize("left", range(0, 206, 5))
def test_a_line_cut_short_costs_that_line_alone(three, left):
    size = len(lines(three.path)[0])
    os.truncate(three.path, 2 * size + left)
    three.append([(key(5), action(5))])
    assert set(three.read()) == {key(0), key(1), key(5)}


def test_no_changed_byte_gives_another_action(three):
    sound, content = three.read(), three.path.read_bytes()
    for place in range(len(content) // 3):
        three.path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        assert sound.items() >= three.read().items(), place
        assert key(2) in three.read(), place


@pytest.mark.parametrize("content", [b"", b"\n\n", b"\xff" * 500, b"x" * 205 + b"\n"])
def test_a_file_of_anything_else_is_an_empty_index(three, content):
    three.path.write_bytes(content)
    assert three.read() == {}


def test_writers_at_once_lose_nothing(tmp_path):
    made = ActionIndex(tmp_path / "index")

    def write(first):
        for number in range(first, first + 200):
            made.append([(key(number), action(number))])

    threads = [threading.Thread(target=write, args=(1000 * writer,)) for writer in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert made.read() == {key(n): action(n) for first in range(0, 4000, 1000) for n in range(first, first + 200)}


@pytest.mark.parametrize("keep", ["always", "auto", "never"])
def test_a_plan_of_hits_opens_no_record(folder, store, keep, opened_records):
    made = run_sync(chain(folder, keep=keep), store)
    plain = {name: entry.ref for name, entry in make_plan(chain(folder, keep=keep), store).entries.items()}
    opened_records.clear()
    planned = make_plan(chain(folder, keep=keep), store)
    assert (planned.counts["hit"], opened_records) == (24, [])
    assert {name: entry.ref for name, entry in planned.entries.items()} == plain
    assert {name: entry.ref.digest for name, entry in planned.entries.items()} == index(made)


def test_a_missing_index_is_rebuilt_from_the_records(folder, store, opened_records):
    run_sync(chain(folder), store)
    sound = store.index.read()
    store.index.path.unlink()
    opened_records.clear()
    assert make_plan(chain(folder), store).counts["hit"] == 24
    assert set(opened_records) == set(sound)
    assert store.index.read() == sound
    opened_records.clear()
    assert make_plan(chain(folder), store).counts["hit"] == 24
    assert opened_records == []


def test_a_damaged_line_is_read_from_its_record_again(folder, store, opened_records):
    run_sync(chain(folder), store)
    sound, content = store.index.read(), bytearray(store.index.path.read_bytes())
    content[100] ^= 1
    store.index.path.write_bytes(content)
    opened_records.clear()
    assert make_plan(chain(folder), store).counts["hit"] == 24
    assert len(opened_records) == 1
    assert store.index.read() == sound


def test_a_store_that_cannot_be_written_is_planned_without(folder, store, monkeypatch):
    run_sync(chain(folder), store)
    store.index.path.unlink()
    store.index.path.mkdir()
    assert make_plan(chain(folder), store).counts["hit"] == 24
    assert run_sync(chain(folder, factor=3.0), store).counts["computed"] == 17


def entry_of(store, name):
    return find_run(store).index[name]


def group(store, name):
    return store.object_path(entry_of(store, name)["digest"])


@pytest.mark.parametrize("lost", ["group", "manifest", "both", "record"])
def test_what_is_gone_as_a_whole_is_made_again_by_the_next_run(folder, store, lost):
    made = run_sync(chain(folder, keep="always"), store)
    path = group(store, "scale/step_03")
    if lost in ("group", "both"):
        shutil.rmtree(path)
    if lost in ("manifest", "both"):
        path.with_suffix(".json").unlink()
    if lost == "record":
        store.record_path(entry_of(store, "scale/step_03")["key"]).unlink()
    again = run_sync(chain(folder, keep="always"), store)
    assert (again.counts["computed"], again.ok, index(again) == index(made)) == (1, True, True)
    assert verify(store) == []
    assert list(again.product("scale/step_03")["values"]) == [6.0] * 10


@pytest.mark.parametrize("file", ["values/c.0", "values/zarr.json", "values"])
def test_a_file_that_is_gone_is_made_again_where_it_is_read(folder, store, file):
    """The listing does not show it; the stage that reads it does, and the run then makes it again."""
    made = run_sync(chain(folder, keep="always"), store)
    path = group(store, "scale/step_03") / file
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert [damage.what for damage in verify(store)] == [index(made)["scale/step_03"]]
    for name in ("difference/step_03", "difference/step_04"):
        store.record_path(entry_of(store, name)["key"]).unlink()
    cache.clear()  # as in another process
    again = run_sync(chain(folder, keep="always"), store)
    assert (again.ok, index(again) == index(made)) == (True, True)
    if file != "values/zarr.json":  # not needed for reading
        assert again.outcomes["scale/step_03"].status == "computed"
        assert verify(store) == []
    assert list(again.product("scale/step_03")["values"]) == [6.0] * 10


def test_when_one_product_turns_out_damaged_all_are_looked_at(folder, store):
    """Each of these would be found only by the task that reads it, one after the other."""
    made = run_sync(chain(folder, keep="always"), store)
    names = [f"{stage}/step_{step:02}" for stage in ("read", "scale") for step in range(2, 7)]
    for name in names:
        (group(store, name) / "values" / "c.0").unlink()
    store.record_path(entry_of(store, "difference/step_03")["key"]).unlink()
    cache.clear()
    again = run_sync(chain(folder, keep="always"), store)
    assert (again.ok, index(again) == index(made)) == (True, True)
    assert {name for name, outcome in again.outcomes.items() if outcome.status == "computed"} == {
        *names,
        "difference/step_03",
    }


def test_a_hit_that_cannot_be_read_afterwards_is_made_again_by_the_next_run(folder, store):
    run_sync(chain(folder, keep="always"), store)
    (group(store, "scale/step_03") / "values" / "c.0").unlink()
    cache.clear()
    with pytest.raises(DamagedError, match="run again to make it"):
        run_sync(chain(folder, keep="always"), store).product("scale/step_03")["values"]
    again = run_sync(chain(folder, keep="always"), store)
    assert again.counts["computed"] == 1
    assert list(again.product("scale/step_03")["values"]) == [6.0] * 10


def test_a_product_stored_after_all_is_seen(folder, store, opened_records):
    """What was made again before is stored by another run with the same result."""
    run_sync(chain(folder, keep="never"), store)
    entry = entry_of(store, "scale/step_03")
    assert not store.index.read()[entry["key"]].kept
    shutil.rmtree(store.path / "actions")
    run_sync(chain(folder, keep="always"), store)
    planned = make_plan(chain(folder, keep="never"), store)
    assert planned.entries["scale/step_03"].ref.recipe is None
    assert store.index.read()[entry["key"]].kept


def test_other_code_is_found_by_the_index(folder, store, monkeypatch):
    run_sync(chain(folder), store)
    other = Fingerprint("sha256:" + "0" * 64)
    monkeypatch.setattr(plans.Sources, "fingerprint", lambda *_: other)
    counts = {policy: make_plan(chain(folder), store, code_policy=policy) for policy in ("recompute", "warn", "ignore")}
    assert [(found.counts["hit"], len(found.warnings)) for found in counts.values()] == [(0, 0), (24, 6), (24, 0)]


def test_freeing_the_store_takes_lines_out_of_the_index(folder, store):
    for factor in (2.0, 3.0):
        run_sync(chain(folder, keep="always", factor=factor), store)
    assert len(store.index.read()) == 41
    collect(store, keep_runs=1, grace_s=0)
    assert len(store.index.read()) == 41
    collect(store, keep_runs=1, grace_s=0, delete=True)
    assert set(store.index.read()) == {entry["key"] for entry in find_run(store).index.values()}
    assert run_sync(chain(folder, keep="always", factor=3.0), store).counts["hit"] == 24


@pytest.mark.parametrize("damage", [b"", b"[" * 100_000, b"{}"])
def test_a_damaged_manifest_does_not_ask_to_run_again_for_ever(folder, store, damage):
    """The index only looks whether it is there; whoever reads it sets it aside."""
    made = run_sync(chain(folder, keep="always"), store)
    store.manifest_path(index(made)["report"]).write_bytes(damage)
    assert make_plan(chain(folder, keep="always"), store).counts["hit"] == 24
    with pytest.raises(DamagedError, match="was moved into quarantine; run again"):
        made.product("report")
    again = run_sync(chain(folder, keep="always"), store)
    assert (again.counts["computed"], index(again)) == (1, index(made))
    assert again.product("report").attrs == {"last": 10.0, "steps": [f"step_0{k}" for k in range(2, 7)]}


@pytest.mark.parametrize(
    ("tail", "damaged"), [(b"", 0), (b"3f", 0), (b"null", 1), (b"\0\0", 1), (b"a" * 206, 1), (b"\n", 1)]
)
def test_only_the_beginning_of_a_line_may_stand_at_the_end(three, tail, damaged):
    """Another process may be writing it."""
    three.path.write_bytes(three.path.read_bytes() + tail)
    assert three.damaged_lines() == damaged


def test_a_pipe_in_the_place_of_the_index_is_not_waited_for(three):
    three.path.unlink()
    os.mkfifo(three.path)
    three.append([(key(7), action(7))])
    assert three.read() == {}
