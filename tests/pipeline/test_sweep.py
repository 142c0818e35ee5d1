"""Variants of a pipeline."""

import copy

import pytest

from dicflow.errors import ConfigurationError
from dicflow.io.configuration import parse
from dicflow.pipeline.sweep import variants, with_settings

BASE = "stages:\n  a: {stage: x, p: 1, deep: {q: 2}}\n  b: {stage: y}\n"


def _values(sweep):
    return [variant.values for variant in variants(parse(BASE + sweep, "p.yaml"))]


def test_no_sweep_is_one_variant_without_values():
    assert _values("") == [{}]


def test_grid_combines_every_value_with_every_other():
    assert _values("sweep: {grid: {a.p: [1, 2], b.r: [x, y, z]}}") == [
        {"a.p": p, "b.r": r} for p in (1, 2) for r in ("x", "y", "z")
    ]


def test_zip_goes_along_and_multiplies_with_grid():
    values = _values("sweep: {grid: {a.p: [1, 2]}, zip: {b.r: [5, 6], b.s: [7, 8]}}")
    assert values == [{"a.p": p, "b.r": r, "b.s": s} for p in (1, 2) for r, s in ((5, 7), (6, 8))]


def test_list_adds_and_exclude_removes():
    values = _values("sweep: {grid: {a.p: [1, 2]}, list: [{a.p: 9}], exclude: [{a.p: 2}]}")
    assert values == [{"a.p": 1}, {"a.p": 9}]


def test_a_value_goes_to_its_place_and_leaves_the_file_alone():
    document = parse(BASE + "sweep: {grid: {a.deep.q: [3], b.new.r: [4]}}", "p.yaml")
    (variant,) = variants(document)
    assert variant.document.data["stages"] == {
        "a": {"stage": "x", "p": 1, "deep": {"q": 3}},
        "b": {"stage": "y", "new": {"r": 4}},
    }
    assert document.data["stages"]["a"]["deep"] == {"q": 2}


def test_settings_change_or_sweep():
    document = with_settings(parse(BASE, "p.yaml"), ["a.p=[1, 2]", "a.deep.q=1e-3,2 cm"])
    assert document.data["stages"]["a"]["p"] == [1, 2]
    assert [variant.values for variant in variants(document)] == [{"a.deep.q": 0.001}, {"a.deep.q": "2 cm"}]


@pytest.mark.parametrize(
    ("sweep", "values"),
    [
        ("{grid: {a.p: [1, 2]}}", [{}]),
        ("{grid: {a.p: [1, 2], b.r: [3, 4]}}", [{"b.r": 3}, {"b.r": 4}]),
        ("{zip: {a.p: [1, 2], b.r: [3, 4]}}", [{"b.r": 3}, {"b.r": 4}]),
        ("{list: [{a.p: 1}, {a.p: 2, b.r: 3}, {a.p: 1, b.r: 3}]}", [{"b.r": 3}]),
        ("{grid: {a.p: [1, 2], b.r: [3, 4]}, exclude: [{a.p: 9, b.r: 3}]}", [{"b.r": 4}]),
        ("{grid: {a.p: [1, 2], b.r: [3, 4]}, exclude: [{a.p: 1, b.r: 3}]}", [{"b.r": 3}, {"b.r": 4}]),
    ],
)
def test_a_setting_overrides_the_sweep(sweep, values):
    found = variants(with_settings(parse(BASE + f"sweep: {sweep}", "p.yaml"), ["a.p=9"]))
    assert [variant.values for variant in found] == values
    assert {variant.document.data["stages"]["a"]["p"] for variant in found} == {9}


@pytest.mark.parametrize("part", ["grid: {a.p: [1, 2]}", "zip: {a.p: [1, 2]}", "list: [{a.p: 1}]"])
def test_values_on_the_command_line_override_those_of_the_sweep(part):
    text = BASE + f"sweep: {{{part}, exclude: [{{a.p: 8}}]}}"
    found = variants(with_settings(parse(text, "p.yaml"), ["a.p=7,8,9"]))
    assert [variant.values for variant in found] == [{"a.p": 7}, {"a.p": 9}]


@pytest.mark.parametrize(
    ("sweep", "message"),
    [
        ("sweep: {gird: {}}", r"p.yaml:4:9: sweep: unknown key 'gird', did you mean 'grid'\?"),
        ("sweep: {grid: {a.p: 3}}", "p.yaml:4:9: sweep: 'grid' "),
        ("sweep: {zip: {a.p: [1], b.r: [1, 2]}}", r"lengths \[1, 2\]"),
        ("sweep: {grid: {a.p: [1]}, zip: {a.p: [2]}}", "under grid and zip"),
        ("sweep: {grid: {c.p: [1]}}", "no stage 'c'"),
        ("sweep: {grid: {a.p: [1]}, exclude: [{a.p: 1}]}", "no variant left"),
        (
            "sweep: {grid: {a.p: [1]}, exclude: [{a.q: 1}]}",
            r"p.yaml:4:38: sweep: exclude names 'a.q', .* did you mean 'a.p'\?; use one of a.p",
        ),
        ("sweep: 3", "not a mapping"),
        (
            "sweep: {grid: {" + ", ".join(f"a.p{k}: [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]" for k in range(60)) + "}}",
            r"p.yaml:4:1: sweep: 1e\+60 variants, at most 1,000 are possible; shorten",
        ),
        ("sweep: {grid: {a.p: [1, 2]}, list: [" + "{a.p: 1}, " * 999 + "]}", "sweep: 1001 variants"),
        ("sweep: {grid: {a.p: [1]}, exclude: [" + "{a.p: 2}, " * 1001 + "]}", "sweep: 1001 variants"),
        ("sweep: {grid: {" + ", ".join(f"a.p{k}: [0]" for k in range(101)) + "}}", "varies 101 parameters"),
        ("sweep: {grid: {a.p" + ".x" * 20 + ": [1]}}", "write stage.parameter"),
    ],
)
def test_a_wrong_sweep(sweep, message):
    with pytest.raises(ConfigurationError, match=message):
        _values(sweep)


@pytest.mark.parametrize("setting", ["a.p", "p=3", "=3", "a.\x1b[2Jp=3"])
def test_settings_of_another_form(setting):
    with pytest.raises(ConfigurationError, match=r"write stage\.parameter=value"):
        with_settings(parse(BASE, "p.yaml"), [setting])


def test_a_long_file_has_fewer_variants():
    text = BASE + f"# the\ntitle: [{'1, ' * 2000}]\nsweep: {{grid: {{a.p: [{', '.join(map(str, range(600)))}]}}}}"
    with pytest.raises(ConfigurationError, match="600 variants of stages with 2,"):
        variants(parse(text, "p.yaml"))


def test_values_of_a_sweep_hide_the_places_below_them():
    document = parse(BASE + "sweep: {grid: {a.p: [{x: 1}, 2]}}", "p.yaml")
    first, _ = (variant.document for variant in variants(document))
    assert first.where(("stages", "a", "p")) == document.where(("sweep", "grid", "a.p"))
    assert first.where(("stages", "a", "p", "x")) == document.where(("sweep", "grid", "a.p"))
    assert first.where(("stages", "a", "stage")) == document.where(("stages", "a", "stage"))


def test_variants_leave_the_file_as_it_is():
    document = parse(BASE + "sweep: {grid: {a.p: [1, 2], b.new.deep: [3]}}", "p.yaml")
    kept = copy.deepcopy(document.data)
    found = variants(document)
    assert document.data == kept
    assert [variant.document.data["stages"]["b"]["new"] for variant in found] == [{"deep": 3}] * 2
