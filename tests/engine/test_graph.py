import os
from typing import ClassVar, Literal

import pytest
from toys import Difference, Read, Rig, Scale, chain, numbers

from dicflow.engine.graph import StageSpec, expand, file_fields
from dicflow.engine.node import At, Node, Port, Scope
from dicflow.errors import ConfigurationError, InputError


def test_tasks_have_readable_names_in_an_order_that_works(folder):
    graph = chain(folder)
    assert len(graph.tasks) == 6 + 1 + 6 + 5 + 5 + 1
    assert {"rig", "scale/step_03", "report"} <= set(graph.tasks)
    seen = set()
    for task in graph.tasks.values():
        assert set(task.producers()) <= seen
        seen.add(task.name)


def positions(graph):
    return {name: place for place, name in enumerate(graph.tasks)}


def steps_of(graph, *stages):
    return [task.step for task in graph.tasks.values() if task.stage in stages]


def test_stages_go_through_the_steps_together(folder):
    stages = chain(folder).stages
    graph = expand({name: stages[name] for name in ("read", "difference", "total")} | {
        "scale": StageSpec(Scale(), {"number": "read"}),
    })  # fmt: skip
    assert list(graph.tasks)[:6] == [
        "read/step_01", "scale/step_01", "read/step_02", "scale/step_02", "difference/step_02", "total/step_02",
    ]  # fmt: skip
    assert steps_of(graph, *graph.stages) == sorted(steps_of(graph, *graph.stages))


def test_what_runs_once_comes_where_it_is_needed(folder, tmp_path):
    """The rig and its six files before the first step that takes it; the report, which nothing takes, at the end."""
    other = StageSpec(Read(), {}, numbers(tmp_path / "others"))
    graph = broken(folder, other=other, rig=spec(Rig(), numbers="other"))
    place = positions(graph)
    assert max(place[f"other/step_0{n}"] for n in range(1, 7)) < place["rig"] < place["scale/step_01"]
    assert place["scale/step_01"] < place["read/step_02"]
    assert place["report"] == len(place) - 1
    for task in graph.tasks.values():
        assert all(place[name] < place[task.name] for name in task.producers())


def test_a_stage_that_takes_all_steps_of_a_chain_has_them_first(folder):
    """Each step waits for the mean of all numbers, so those go through their steps before the first of it."""
    graph = chain(folder)
    place = positions(graph)
    assert [f"read/step_0{n}" for n in range(1, 7)] == list(graph.tasks)[:6]
    assert place["rig"] == 6
    steps = steps_of(graph, "scale", "difference", "total")
    assert steps == sorted(steps)


def test_a_pair_is_named_by_the_step_where_it_ends(folder):
    graph = chain(folder)
    assert graph.steps["difference"] == graph.steps["scale"][1:]
    assert graph.tasks["difference/step_02"].inputs == {"before": "scale/step_01", "now": "scale/step_02"}


def test_own_output_of_the_step_before(folder):
    tasks = chain(folder).tasks
    assert tasks["total/step_02"].inputs == {
        "difference": "difference/step_02",
        "so_far": None,
        "first": "read/step_01",
    }
    assert tasks["total/step_03"].inputs["so_far"] == "total/step_02"


def test_all_names_the_steps(folder):
    tasks = chain(folder).tasks
    assert tasks["rig"].inputs["numbers"][0] == ("step_01", "read/step_01")
    assert [step for step, _ in tasks["report"].inputs["totals"]] == [f"step_0{n}" for n in range(2, 7)]


class Early(Node):
    """Once for the test: a few early steps."""

    title: ClassVar = "early"
    scope: ClassVar = Scope.TEST
    gives: ClassVar = "early"
    takes: ClassVar = {"numbers": Port("number", at=At.EARLY, optional=True)}
    stage: Literal["early"] = "early"


def early_steps(folder, count, source="read"):
    """The steps that a stage takes of a series of so many."""
    for step in range(count):
        (folder / f"{step:02d}.txt").write_text("1")
    stages = {"read": StageSpec(Read(), {}, folder), "early": StageSpec(Early(), {"numbers": source})}
    found = expand(stages).tasks["early"].inputs["numbers"]
    return None if found is None else [step for step, _ in found]


def test_early_steps_follow_the_first_one(tmp_path):
    """They do not change with steps that are added later, and of one step there are none."""
    assert early_steps(tmp_path, 1) is None
    assert early_steps(tmp_path, 3) == ["01", "02"]
    assert early_steps(tmp_path, 10) == ["01", "02", "04", "08"]
    assert early_steps(tmp_path, 60) == early_steps(tmp_path, 17) == ["01", "02", "04", "08", "16"]


def test_what_is_gathered_by_a_stage(folder):
    gathered = chain(folder).gathered()
    assert {"read/step_01", "total/step_06"} <= gathered
    assert not {"difference/step_02", "rig", "report"} & gathered


class Steps(Node):
    """Per step: takes everything that a step can take."""

    title: ClassVar = "steps"
    scope: ClassVar = Scope.STEP
    gives: ClassVar = "steps"
    takes: ClassVar = {
        "number": Port("number", at=At.PREVIOUS),
        "pair": Port("difference", optional=True),
        "pair_before": Port("difference", at=At.PREVIOUS),
        "first_pair": Port("difference", at=At.FIRST),
        "rig": Port("rig", at=At.ALL),
        "own": Port("steps", at=At.FIRST, own=True),
    }
    stage: Literal["steps"] = "steps"


def test_a_stage_that_reads_attributes_alone_gathers_nothing(folder):
    class Names(Rig):
        def gathers(self, port):
            return False

    stages = {"read": StageSpec(Read(), {}, folder), "names": StageSpec(Names(), {"numbers": "read"})}
    assert expand(stages).gathered() == frozenset()


def test_what_a_step_takes_from_pairs_and_from_what_runs_once(folder):
    inputs = {"number": "scale", "pair": "difference", "pair_before": "difference", "first_pair": "difference"}
    graph = expand({**chain(folder).stages, "steps": StageSpec(Steps(stage="steps"), {**inputs, "rig": "rig"})})
    always = {"first_pair": "difference/step_02", "rig": (("rig", "rig"),)}
    assert graph.tasks["steps/step_01"].inputs == {
        **always, "number": None, "pair": None, "pair_before": None, "own": None,
    }  # fmt: skip
    assert graph.tasks["steps/step_03"].inputs == {
        **always, "number": "scale/step_02", "pair": "difference/step_03", "pair_before": "difference/step_02",
        "own": "steps/step_01",
    }  # fmt: skip


def test_a_step_that_needs_a_pair_is_refused_since_the_first_has_none(folder):
    class Needs(Steps):
        takes: ClassVar = {"pair": Port("difference")}
        stage: Literal["needs"] = "needs"

    with pytest.raises(ConfigurationError, match=r"at the first step.*'difference'.*'pair'; .*Scope\.PAIR"):
        expand({**chain(folder).stages, "needs": StageSpec(Needs(), {"pair": "difference"})})


def test_one_step_makes_no_pair(tmp_path):
    graph = chain(numbers(tmp_path, 1))
    assert graph.steps["total"] == ()
    assert graph.tasks["report"].inputs == {"totals": ()}


def test_upstream_leaves_out_what_is_not_needed(folder):
    part = chain(folder).upstream(["scale"])
    assert set(part.stages) == {"read", "rig", "scale"}
    assert {task.stage for task in part.tasks.values()} == set(part.stages)


def test_a_file_among_the_parameters_is_relative_to_its_folder(folder):
    task = chain(folder, table="table.txt").tasks["scale/step_01"]
    assert task.files == {"table_path": folder / "table.txt"}
    assert chain(folder).tasks["scale/step_01"].files == {}
    assert file_fields(Scale) == {"table"}


def test_a_file_whose_name_is_no_text_is_refused(folder):
    with pytest.raises(InputError, match=r"caf\\udce9\.txt': the name is not in UTF-8; rename the file"):
        chain(folder, table=os.fsdecode(b"caf\xe9.txt"))


def spec(node, where="a.yaml:3:1", **inputs):
    return StageSpec(node, inputs, where=where)


def broken(folder, **changed):
    return expand({**chain(folder).stages, **changed})


def test_an_unknown_producer_is_named_with_its_place(folder):
    with pytest.raises(ConfigurationError, match=r"^a\.yaml:3:1: scale: input 'number' names an unknown stage 'raed'"):
        broken(folder, scale=spec(Scale(), number="raed"))


def test_a_product_of_another_kind(folder):
    with pytest.raises(ConfigurationError, match="needs number, but 'rig' gives rig"):
        broken(folder, scale=spec(Scale(), number="rig"))


def test_a_missing_input(folder):
    with pytest.raises(ConfigurationError, match=r"needs an input 'before' \(number\)"):
        broken(folder, difference=spec(Difference(), now="scale"))


def test_an_unknown_port(folder):
    with pytest.raises(ConfigurationError, match="has no input 'numbr'; its inputs are number, rig"):
        broken(folder, scale=spec(Scale(), number="read", numbr="read"))


def test_a_cycle_is_shown(folder):
    with pytest.raises(ConfigurationError, match=r"one → two → one|two → one → two"):
        broken(folder, one=spec(Scale(), number="two"), two=spec(Scale(), number="one"))


def test_two_series_do_not_mix(folder, tmp_path):
    other = StageSpec(Read(), {}, numbers(tmp_path / "others"))
    with pytest.raises(ConfigurationError, match=r"mixes the steps of (read and other|other and read)"):
        broken(folder, other=other, difference=spec(Difference(), before="read", now="other"))


def test_two_series_meet_in_what_runs_once(folder, tmp_path):
    other = StageSpec(Read(), {}, numbers(tmp_path / "others", 2))
    graph = broken(folder, other=other, rig=spec(Rig(), numbers="other"))
    assert len(graph.tasks["rig"].inputs["numbers"]) == 2
    assert graph.tasks["scale/step_06"].inputs == {"number": "read/step_06", "rig": "rig"}


def test_steps_need_a_series(folder):
    with pytest.raises(ConfigurationError, match="none of its inputs has any"):
        expand({"rig": StageSpec(Once(stage="once")), "scale": spec(Scale(), number="rig")})


class Once(Node):
    """Runs once, on one product of its input."""

    title: ClassVar = "once"
    scope: ClassVar = Scope.TEST
    gives: ClassVar = "number"
    takes: ClassVar = {"total": Port("total", optional=True)}
    stage: Literal["once"] = "once"


def test_what_runs_once_cannot_follow_steps(folder):
    with pytest.raises(ConfigurationError, match="runs once, so input 'total' cannot follow the steps of 'total'"):
        broken(folder, once=spec(Once(stage="once"), total="total"))
