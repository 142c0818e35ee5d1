"""YAML 1.2 with positions."""

import math

import pytest

from dicflow.errors import ConfigurationError
from dicflow.io.configuration import parse, parse_value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 0.001), ("012", 12), ("0o17", 15), ("on", "on"), ("no", "no"), ("true", True), ("~", None),
        ("[1, 2.5]", [1, 2.5]), ("14.5 mm", "14.5 mm"), ("'7'", "7"), ("1:30", "1:30"), ("2026-01-01", "2026-01-01"),
    ],
)  # fmt: skip
def test_scalars_follow_yaml_1_2(text, value):
    assert parse_value(text) == value
    assert type(parse_value(text)) is type(value)


def test_not_a_number_is_read_as_one_for_validation_to_refuse():
    assert math.isnan(parse_value(".nan"))


def test_positions_count_from_one():
    document = parse("stages:\n  a:\n    size: [1, 20]\n", "p.yaml")
    assert document.where(("stages", "a", "size")) == "p.yaml:3:5"
    assert document.where(("stages", "a", "size", 1)) == "p.yaml:3:15"
    assert document.where(("stages", "a", "absent")) == "p.yaml:2:3"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: 2\na: 3\n", r"p.yaml:3:1: key 'a' is given twice, first in line 1"),
        ("- 1\n", "p.yaml:1:1: expected a mapping .* found a list"),
        ("", "found an empty file"),
        ("a: [1\n", "p.yaml:2:1: not valid YAML"),
        ("a: !!python/object/apply:os.system ['true']\n", "p.yaml:1:4: the tag .* is not allowed"),
        ("a: !mine 1\n", "is not allowed"),
        ("a: &x [*x]\n", "an alias refers to a value that contains it"),
        ("? [1]\n: 2\n", "a key must be a word"),
        (
            "a: " + "[" * 3000 + "]" * 3000,
            "p.yaml:1:53: more than 50 lists or mappings inside each other",
        ),
        ("a: " + "[" * 100_000, "p.yaml:1:53: more than 50"),
        ("l0: &l0 1\n" + "".join(f"l{i}: &l{i} [*l{i - 1}]\n" for i in range(1, 90)), "more than 50 lists"),
        ("a: " + "7" * 5000, "p.yaml:1:4: a number of 5000 digits"),
        ("a: 0x" + "f" * 5000, "a number of 5002 digits"),
    ],
)
def test_what_is_refused_names_the_place(text, message):
    with pytest.raises(ConfigurationError, match=message):
        parse(text, "p.yaml")


def test_multiplying_aliases_are_stopped():
    levels = "".join(f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 10)}]\n" for i in range(1, 9))
    with pytest.raises(ConfigurationError, match="aliases may have multiplied"):
        parse("l0: &l0 [1]\n" + levels, "p.yaml")
