"""JSON with a check sum of its own."""

import json
import os
import socket

import pytest

from dicflow.engine.stored_json import (
    anything,
    fields,
    is_count,
    is_flag,
    is_number,
    is_text,
    list_of,
    mapping_of,
    one_of,
    read_stored,
    seal,
    stored,
    unseal,
)
from dicflow.engine.whole_file import LARGEST_TEXT, read_file
from tests.replaced import replace_here

VALUES = [{}, {"a": 1}, {"crc32": "x", "b": [1.5, None, "é", {"c": True}]}, {"": ""}, {"a": "\udce9"}, {"a": 10**300}]


@pytest.mark.parametrize("value", VALUES)
def test_a_mapping_comes_back(value):
    assert unseal(seal(value), anything) == value
    assert b"\n" not in seal(value)


@pytest.mark.parametrize("value", VALUES[:2] + VALUES[3:])
def test_a_sealed_mapping_is_one_json_mapping_with_one_more_entry(value):
    found = json.loads(seal(value))
    assert next(iter(found)) == "crc32"
    del found["crc32"]
    assert found == value


def test_what_has_no_check_sum_is_taken_for_what_it_says():
    assert unseal(b'{"a": 1}', anything) == {"a": 1}
    assert unseal(b'{"crc33":"00000000","a":1}', anything) == {"crc33": "00000000", "a": 1}


@pytest.mark.parametrize("value", VALUES)
def test_no_flipped_bit_and_no_cut_passes(value):
    content = seal(value)
    for place in range(len(content)):
        for bit in range(8):
            with pytest.raises(ValueError, match="check sum"):
                unseal(content[:place] + bytes([content[place] ^ 1 << bit]) + content[place + 1 :], anything)
        with pytest.raises(ValueError, match=r"check sum|is not JSON|is empty"):
            unseal(content[:place], anything)


def test_files_and_numbers_of_values_that_could_fill_the_memory_are_refused_unread(tmp_path, monkeypatch):
    path = tmp_path / "index.json"
    with path.open("wb") as file:
        file.truncate(LARGEST_TEXT + 1)
    replace_here(monkeypatch, json, "loads", lambda *_: pytest.fail("is read"))
    with pytest.raises(ValueError, match="larger than"):
        read_stored(path, anything)
    with pytest.raises(ValueError, match="too many values"):
        unseal(b'{"a":[%b[]]}' % (b"[]," * 10_000_001), anything)


@pytest.mark.parametrize("text", ["", "[1]", "null", "3", '"a"', "{", "\0\0\0", "{}{}", '{"a":%s}' % ("9" * 5000)])
def test_what_is_no_mapping_is_refused(text):
    with pytest.raises(ValueError, match=r"is not JSON|is empty|something else"):
        unseal(text.encode(), anything)


@pytest.mark.parametrize("depth", [101, 900, 100_000])
@pytest.mark.parametrize(("opening", "closing"), [("[", "]"), ('{"a":', "}")])
def test_depth_is_refused_whether_or_not_it_could_be_parsed(depth, opening, closing):
    with pytest.raises(ValueError, match="nested too deeply"):
        unseal(f'{{"a":{opening * depth}1{closing * depth}}}'.encode(), anything)
    assert unseal(b'{"a":%s}' % b",".join([b"[[]]"] * 300).join([b"[", b"]"]), anything)


ENTRY = fields({"key": is_text}, {"size": is_count})


@pytest.mark.parametrize(
    ("form", "fits", "others"),
    [
        (is_text, ["", "a"], [None, 1, []]),
        (is_flag, [True, False], [0, 1, None]),
        (is_number, [0, -1.5, 10**299], [True, "1", float("nan"), float("inf"), 10**400, None]),
        (is_count, [0, 3], [-1, 1.0, True, "1", None]),
        (one_of("a", "b"), ["a"], ["c", None, [], {}]),
        (list_of(is_text), [[], ["a"]], ["a", {}, [1]]),
        (mapping_of(is_count), [{}, {"a": 1}], [[], {"a": "b"}]),
        (mapping_of(anything, one_of("a")), [{}, {"a": None}], [{"b": 1}]),
        (ENTRY, [{"key": "a"}, {"key": "a", "size": 1}], [{}, {"size": 1}, {"key": 1}, {"key": "a", "x": 1}, [], None]),
    ],
)
def test_forms(form, fits, others):
    assert all(form(value) for value in fits)
    assert not any(form(value) for value in others)


def listening(path):
    server = socket.socket(socket.AF_UNIX)
    server.bind(os.fspath(path))
    server.close()


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir, listening, lambda path: path.symlink_to("/dev/zero")])
def test_only_regular_files_are_read(tmp_path, monkeypatch, make):
    """A pipe without a writer would be waited for, and a device never ends."""
    monkeypatch.chdir(tmp_path)  # a socket's name is short
    path = tmp_path.relative_to(tmp_path) / "x"
    make(path)
    with pytest.raises(OSError, match="not a regular file"):
        read_file(path)
    with pytest.raises(ValueError, match="not a regular file"):
        read_stored(path, anything)
    assert stored(path, anything) is None
