"""Stages that look at each step: a long series is looked at in parts, which are kept."""

from typing import ClassVar, Literal

import numpy as np
import pytest
from toys import Read, StageSpec, expand, numbers, run_sync, write

from dicflow.engine.looks import AT_ONCE
from dicflow.engine.node import At, Node, Port, Scope, parameter
from dicflow.engine.plan import make_plan
from dicflow.engine.product import Product, Variable

COUNT = 2 * AT_ONCE + 5


class Extremes(Node):
    """Once: the least and largest number, times a factor."""

    title: ClassVar = "extremes"
    scope: ClassVar = Scope.TEST
    gives: ClassVar = "extremes"
    takes: ClassVar = {
        "numbers": Port("number", at=At.ALL),
        "scale": Port("number", at=At.FIRST),
        "beside": Port("number", at=At.FIRST, optional=True),
    }
    stage: Literal["extremes"] = "extremes"
    factor: float = parameter(1.0, "factor")
    looked_at: ClassVar[list[float]] = []

    def look(self, numbers, scale):
        value = float(numbers["values"].mean() * scale["values"][0])
        self.looked_at.append(value)
        return Product("one", {"pair": Variable(("side",), np.array([value, np.nan]), "mm", "a pair")}, {"text": "é"})

    def run(self, numbers, scale, beside=None):
        values = np.array([one["pair"] for one in numbers])
        assert np.isnan(values[:, 1]).all()
        assert {(one.kind, one.attrs["text"], one.variables["pair"].units) for one in numbers} == {("one", "é", "mm")}
        found = Variable(("side",), self.factor * np.array([values[:, 0].min(), values[:, 0].max()]))
        return Product("extremes", {"extremes": found}, {"steps": list(numbers.steps)})


def graph(folder, **parameters):
    stages = {
        "read": StageSpec(Read(keep="always"), {}, folder),
        "ends": StageSpec(Extremes(**parameters), {"numbers": "read", "scale": "read"}),
    }
    return expand(stages)


@pytest.fixture
def folder(tmp_path):
    folder = numbers(tmp_path / "numbers", 0)
    add(folder, range(1, COUNT + 1))
    return folder


def add(folder, chosen):
    for number in chosen:
        write(folder / f"step_{number:03d}.txt", str(number))


def looked_at(folder, store, **parameters):
    """Numbers that a run looks at, and its result."""
    Extremes.looked_at.clear()
    result = run_sync(graph(folder, **parameters), store)
    assert result.ok
    return Extremes.looked_at.copy(), result


def test_each_step_is_looked_at_once_and_seen_in_order(folder, store):
    seen, result = looked_at(folder, store)
    assert sorted(seen) == list(range(1, COUNT + 1))
    product = result.product("ends")
    assert product["extremes"].tolist() == [1.0, COUNT]
    assert product.attrs["steps"] == [f"step_{number:03d}" for number in range(1, COUNT + 1)]
    assert result.by_stage()["ends"]["computed"] == 3


def test_a_series_that_grows_is_looked_at_behind_its_last_part(folder, store):
    looked_at(folder, store)
    add(folder, [COUNT + 1])
    seen, result = looked_at(folder, store)
    assert seen == list(range(2 * AT_ONCE + 1, COUNT + 2))
    assert result.product("ends")["extremes"].tolist() == [1.0, COUNT + 1]
    add(folder, range(COUNT + 2, 3 * AT_ONCE + 1))
    assert sorted(looked_at(folder, store)[0]) == list(range(2 * AT_ONCE + 1, 3 * AT_ONCE + 1))


def test_a_changed_step_is_looked_at_with_its_part_alone(folder, store):
    looked_at(folder, store)
    write(folder / "step_040.txt", "1000", age_s=30.0)
    seen, result = looked_at(folder, store)
    rest = set(range(2 * AT_ONCE + 1, COUNT + 1))
    assert set(seen) == set(range(AT_ONCE + 1, 2 * AT_ONCE + 1)) - {40} | {1000} | rest
    assert result.product("ends")["extremes"].tolist() == [1.0, 1000.0]


def test_what_every_look_takes_and_a_parameter_count(folder, store):
    looked_at(folder, store)
    assert len(looked_at(folder, store, factor=2.0)[0]) == COUNT
    write(folder / "step_001.txt", "2", age_s=30.0)  # the scale of all
    assert sorted(looked_at(folder, store)[0]) == sorted([4.0, *(2.0 * number for number in range(2, COUNT + 1))])


def test_a_short_series_has_no_parts(tmp_path, store):
    folder = numbers(tmp_path / "few", AT_ONCE - 1)
    assert [task.name for task in graph(folder).tasks_of("ends")] == ["ends"]
    assert len(looked_at(folder, store)[0]) == AT_ONCE - 1


def test_parts_are_due_with_their_last_step(folder):
    names = list(graph(folder).tasks)
    part = names.index(f"ends/step_001…step_{AT_ONCE:03d}")
    assert names[part - 1] == f"read/step_{AT_ONCE:03d}"


def test_a_plan_says_what_each_part_waits_for_and_that_it_is_there(folder, store):
    entries = make_plan(graph(folder), store).entries
    assert entries[f"ends/step_001…step_{AT_ONCE:03d}"].waits_for[0] == "read/step_001"
    looked_at(folder, store)
    assert {entry.state for entry in make_plan(graph(folder), store).entries.values()} == {"hit"}
