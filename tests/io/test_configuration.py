"""YAML 1.2 with positions."""

import math

import pytest

from dicflow.errors import ConfigurationError
from dicflow.io.configuration import parse, parse_value, read


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
        ("a: [1\n", "p.yaml:1:4: not valid YAML"),
        ("a: 1\nb: {c: [1, 2]\nd: 3\n", "p.yaml:2:4: not valid YAML: .*close the bracket"),
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


BACK_SLASH = "write / between folders, or put the text in single quotes"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('a: "photos\\*.png"', rf"p.yaml:1:11: .*unknown escape.*; {BACK_SLASH}"),
        ('a: "C:\\Users\\me"', rf"p.yaml:1:\d+: .*; {BACK_SLASH}"),
        ('b: é\na: "C:\\temp"', rf"p.yaml:2:4: \\t in double quotes is a special character; {BACK_SLASH}"),
        ('a: {b: "x\\new"}', rf"p.yaml:1:8: \\n in double quotes .*; {BACK_SLASH}"),
        ('a: "\\e]0;owned\\a"', r"p.yaml:1:4: \\e in double quotes"),
        ('a: "x\\u001b"', r"p.yaml:1:4: control characters, x\\u001b"),
        ('"a\\x9b": 1', "p.yaml:1:1: control characters"),
        ("a:\n\tb: 1\n", "p.yaml:2:1: .*a tab in the indentation; indent with spaces"),
        ("a:\n  b: 1\n\tc: 2\n", "p.yaml:3:1: .*a tab in the indentation; indent with spaces"),
        ("a: b\n  \t c: 2\n", "p.yaml:2:3: .*a tab in the indentation"),
        ("a: “b/*.png”", "p.yaml:1:4: typographic quotes, .*; write straight ones"),
        ("‘a’: 1", "p.yaml:1:1: typographic quotes"),
        ("a: *.png", r"p.yaml:1:5: .*alias.*; put text that begins with \* or & in quotes"),
        ("a: @b", "p.yaml:1:4: .*; put text that begins with @"),
        ('b: 1\na: "b\nc: 1', "p.yaml:2:4: .*; close the quote"),
        ("a: [1, 2\nb: 3", "p.yaml:1:4: .*; close the bracket"),
        ("a: b: c", "p.yaml:1:5: .*; check the indentation, and put text that holds ': ' in quotes"),
        ("a: 1\n---\nb: 2", "p.yaml:2:1: .*; leave only one document"),
        ("a: !!int 3", "the tag .*int is not allowed; write plain values"),
        ("a: \x1b[2J", r"p.yaml:1:4: holds the control character U\+001B"),
        ("rig\tht: 1", "p.yaml:1:1: key .* holds a tab"),
        ("a: 9223372036854775809", "a whole number beyond 9e"),
        ("a: " + "x" * 20_000, "text of 20,000 characters"),
        ("a: [" + "1," * 1_000_000 + "]", "p.yaml:1:99999: more than 50,000 values"),
        ("a: \ud800", "p.yaml: not valid YAML"),
    ],
)
def test_habits_of_editors_and_limits_have_a_remedy(text, message):
    with pytest.raises(ConfigurationError, match=message) as raised:
        parse(text, "p.yaml")
    assert len(raised.value.args) == 3
    assert all(raised.value.args)


def test_spaces_of_typesetting_are_plain_where_yaml_needs_its_own():
    text = "\u00a0\u00a0a:\u00a0{b:\u202f1,\u00a0c: d\u00a0e}\n\u00a0\u00a0f:\u00a0g\u00a0\n"
    assert parse(text, "p.yaml").data == {"a": {"b": 1, "c": "d\u00a0e"}, "f": "g"}


def test_escapes_of_json_and_text_in_blocks_are_read():
    text = '{"a": "\\u00e9 \\\\n \\"x\\" \\/", "b": "C:\\\\n"}'
    assert parse(text, "p.yaml").data == {"a": 'é \\n "x" /', "b": "C:\\n"}
    assert parse("a: |\n  one\n  two\n", "p.yaml").data == {"a": "one\ntwo\n"}


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-32"])
def test_files_of_windows_are_read(tmp_path, encoding):
    (tmp_path / "p.yaml").write_bytes("title: Prüfung\r\nstages:\r\n  a: {b: 1}\r\n".encode(encoding))
    document = read(tmp_path / "p.yaml")
    assert document.data == {"title": "Prüfung", "stages": {"a": {"b": 1}}}
    assert document.where(("stages", "a")) == f"{tmp_path / 'p.yaml'}:3:3"


def test_a_file_that_is_not_unicode_names_the_line_and_the_remedy(tmp_path):
    (tmp_path / "p.yaml").write_bytes("a: 1\ntitle: Prüfung\n".encode("cp1252"))
    with pytest.raises(ConfigurationError, match=r"p\.yaml:2: is not UTF-8 text; save it as plain text in UTF-8"):
        read(tmp_path / "p.yaml")
