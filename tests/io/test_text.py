"""Text files of every encoding, and what is not one."""

import os

import pytest

from dicflow.errors import InputError
from dicflow.io.json_text import read_json
from dicflow.io.text import numbered_lines, printable, read_text

TEXT = "phase,load_g\nPrüfung 漢,1\n"
ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-32", "utf-16-le", "utf-16-be", "utf-32-le", "utf-32-be")


def written(path, data):
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_every_encoding_and_end_of_line(tmp_path, encoding, end):
    path = written(tmp_path / "a.txt", TEXT.replace("\n", end).encode(encoding))
    assert read_text(path, "a table", 1000) == TEXT
    assert list(numbered_lines(path, "a table", 1000)) == [(1, "phase,load_g"), (2, "Prüfung 漢,1")]


def test_big_endian_text_with_its_mark(tmp_path):
    path = written(tmp_path / "a.txt", b"\xfe\xff" + TEXT.encode("utf-16-be"))
    assert read_text(path, "a table", 1000) == TEXT


def test_the_western_code_page_is_read_where_only_ascii_matters(tmp_path):
    path = written(tmp_path / "a.txt", b"one\ntwo \xfc \x81\n")
    assert read_text(path, "a table", 100, western=True) == "one\ntwo ü �\n"
    assert [line for _, line in numbered_lines(path, "a table", 100)] == ["one", "two ü �"]
    with pytest.raises(InputError, match=r"a\.txt:2: is not UTF-8 text; save it .* UTF-8"):
        read_text(path, "a pipeline file", 100)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"a\nb\0c", r":2:2: holds the control character U\+0000"),
        (b"a\x1b[31m", r":1:2: .*U\+001B"),
        (b"a\xc2\x9b", r"U\+009B"),
        (b"\xff\xfea", "damaged UTF-16"),
        (b"\xef\xbb\xbfa\xff", "damaged UTF-8"),
        ("a\ufeffb".encode(), r"U\+FEFF"),
        (b"x" * 101, r"larger \(101 bytes\) than a table may be \(100 bytes\)"),
    ],
)
def test_what_is_not_text_is_refused(tmp_path, data, message):
    path = written(tmp_path / "a.txt", data)
    with pytest.raises(InputError, match=message):
        read_text(path, "a table", 100, western=True)
    with pytest.raises(InputError):
        list(numbered_lines(path, "a table", 100))


def test_a_line_without_end_is_not_read_on(tmp_path):
    path = written(tmp_path / "a.csv", b"a,b\n" + b"1" * 1_000_000)
    with pytest.raises(InputError, match=r"a\.csv:2: is longer than 100,000 characters"):
        list(numbered_lines(path, "a table", 10_000_000))


def test_only_regular_files_are_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="but it is a folder; name the file itself"):
        read_text(tmp_path, "a table", 100)
    for place in (tmp_path / "pipe", "/dev/zero"):
        with pytest.raises(InputError, match="not a regular file; name the file itself"):
            read_text(place, "a table", 100)
    for place in (tmp_path / "absent", "a\0b", "x" * 5000):
        with pytest.raises(InputError, match=r"cannot be read .*; check the path"):
            read_text(place, "a table", 100)


def test_text_for_messages_steers_no_terminal():
    assert printable("a\x1b[2J\x9b\nb") == "a\\u001b[2J\\u009b\\u000ab"
    assert printable("x" * 100, 5) == "xxxxx…"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1,\n 2,,]", r"a\.json:2:4: expected a rig, but it is not valid JSON"),
        ("[" * 100_000, "too many lists or objects inside each other"),
        ('{"a":' * 100_000, "too many lists or objects inside each other"),
        ("[" + "7" * 400 + "]", "a number of 400 digits"),
        ("[" + "7" * 5000 + "]", "a number of 5000 digits"),
        ("[1e999]", "holds 1e999, expected finite numbers"),
        ("[-Infinity]", "holds -Infinity"),
        ("[NaN]", "holds NaN"),
    ],
)
def test_json_is_limited(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_json(written(tmp_path / "a.json", text.encode()), "a rig", 1_000_000)


@pytest.mark.parametrize("encoding", [*ENCODINGS, "cp1252"])
def test_json_in_every_encoding(tmp_path, encoding):
    path = written(tmp_path / "a.json", '{"name": "Prüfung", "a": 1.5}'.encode(encoding))
    assert read_json(path, "a rig", 1000)["a"] == 1.5
