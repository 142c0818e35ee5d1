"""Warnings of products: with every run that uses the product, each once."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal

import pytest
from toys import Difference, Read, StageSpec, chain, expand, field, numbers, run_sync

from dicflow.engine import plan
from dicflow.engine.journal import find_run
from dicflow.engine.node import Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.engine.product_warnings import failures
from dicflow.errors import StageError


class Warns(Node):
    """Per step: the number, with a warning above a limit."""

    title: ClassVar = "warns"
    scope: ClassVar = Scope.STEP
    gives: ClassVar = "number"
    takes: ClassVar = {"number": Port("number")}
    stage: Literal["warns"] = "warns"
    above: float = parameter(3.5, "limit")
    text: str = parameter("the number is large", "its warning")

    def run(self, number: Product) -> Product:
        large = number["values"][0] > self.above
        return field("number", number["values"], **({"warnings": [self.text]} if large else {}))


def warning_graph(folder, **parameters):
    """Two stages one after the other that warn of the same numbers."""
    return expand({
        "read": StageSpec(Read(), {}, folder),
        "first": StageSpec(Warns(**parameters), {"number": "read"}),
        "second": StageSpec(Warns(**parameters), {"number": "first"}),
    })  # fmt: skip


def test_a_product_may_warn_of_one_thing_in_a_bare_sentence():
    assert Product("number", attrs={"warnings": "is odd"}).warnings == ("is odd",)
    assert Product("number", attrs={"warnings": ["is odd", "is large"]}).warnings == ("is odd", "is large")
    assert Product("number").warnings == ()


def test_equal_sentences_are_one_with_the_steps_and_belong_to_the_first_stage(folder, store):
    result = run_sync(warning_graph(folder), store)
    assert result.ok
    assert result.warnings == ["first at 3 of 6 steps, step_04 … step_06: the number is large"]
    single = run_sync(warning_graph(folder, above=5.5), store)
    assert single.warnings == ["first/step_06: the number is large"]


@pytest.mark.parametrize("many", [2000, 1], ids=["by records", "by the index"])
def test_hits_warn_as_what_was_computed(folder, store, monkeypatch, many):
    monkeypatch.setattr(plan, "_MANY", many)
    seen = []
    made = run_sync(warning_graph(folder), store)
    again = run_sync(warning_graph(folder), store, on_event=seen.append)
    assert again.counts["hit"] == 18
    assert again.warnings == made.warnings
    assert [(event.stage, event.text) for event in seen if event.kind == "warning"] == [("first", made.warnings[0])]
    journalled = [event.text for event in find_run(store).events() if event.kind == "warning"]
    assert journalled == made.warnings


def test_a_hit_that_a_worker_finds_warns_too(folder, store):
    """Its producer runs, so that the plan does not know it to be a hit."""
    run_sync(warning_graph(folder), store)
    (folder / "step_06.txt").write_text("6.0 and a comment")
    result = run_sync(warning_graph(folder), store)
    assert result.counts == {"hit": 17, "computed": 1, "failed": 0, "skipped": 0}
    assert result.warnings == ["first at 3 of 6 steps, step_04 … step_06: the number is large"]


def test_other_sentences_stay_apart(folder, store):
    graph = expand({
        "read": StageSpec(Read(), {}, folder),
        "first": StageSpec(Warns(above=5.5), {"number": "read"}),
        "second": StageSpec(Warns(above=5.5, text="is odd"), {"number": "first"}),
    })  # fmt: skip
    assert run_sync(graph, store).warnings == ["first/step_06: the number is large", "second/step_06: is odd"]


class Fails(Node):
    """Has no product where its number is large."""

    title: ClassVar = "fails"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {"number": Port("number")}
    gives: ClassVar = "number"
    stage: Literal["fails"] = "fails"
    above: float = parameter(3.5)

    def run(self, number: Product) -> Product:
        if number["values"][0] > self.above:
            raise StageError("the number is too large")
        return number


def test_each_reason_of_failures_is_given_once_with_its_steps(folder, store):
    graph = expand({
        "read": StageSpec(Read(), {}, folder),
        "some": StageSpec(Fails(), {"number": "read"}),
        "last": StageSpec(Fails(above=5.5), {"number": "read"}),
    })  # fmt: skip
    result = run_sync(graph, store, keep_going=True)
    assert failures(graph, result.outcomes) == [
        "some at 3 of 6 steps, step_04 … step_06: the number is too large",
        "last/step_06: the number is too large",
    ]


class Sparing(Read):
    """Leaves out the last file."""

    stage: Literal["sparing"] = "sparing"

    def steps(self, folder: Path) -> dict[str, dict[str, Path]]:
        return dict(list(super().steps(folder).items())[:-1])

    def left_out(self, folder: Path, steps: dict[str, dict[str, Path]]) -> tuple[str, ...]:
        return (f"{(super().steps(folder).keys() - steps.keys()).pop()} is left out",)


def test_files_that_a_series_leaves_out_are_named(folder, store):
    seen = []
    graph = expand({"read": StageSpec(Sparing(), {}, folder), "first": StageSpec(Warns(above=9.0), {"number": "read"})})
    result = run_sync(graph, store, on_event=seen.append)
    assert result.warnings == ["read: step_06 is left out"]
    assert [(event.stage, event.text) for event in seen if event.kind == "warning"] == [("", result.warnings[0])]
    assert [event.text for event in find_run(store).events() if event.kind == "warning"] == result.warnings


def test_a_series_of_one_step_is_named_if_stages_compare(tmp_path, store):
    one = numbers(tmp_path / "one", 1)
    assert run_sync(chain(one), store).warnings == [
        "read has one step only, with which difference, total cannot compare; add the other steps"
    ]
    alone = {"read": StageSpec(Read(), {}, one), "warns": StageSpec(Warns(), {"number": "read"})}
    assert run_sync(expand(alone), store).warnings == []
    two = numbers(tmp_path / "two", 2)
    pair = {"read": StageSpec(Read(), {}, two), "d": StageSpec(Difference(), {"before": "read", "now": "read"})}
    assert run_sync(expand(pair), store).warnings == []
