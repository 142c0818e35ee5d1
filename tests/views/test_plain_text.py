"""Text on a terminal: no control sequence from a name, no error of an encoding."""

from __future__ import annotations

import io
import json
import sys

import pytest

from dicflow.engine.journal import Event
from dicflow.views.console import consoles, simple_table
from dicflow.views.plain_text import ascii_signs, plain, plain_line
from dicflow.views.progress import Progress

HOSTILE = {
    "\x1b]0;OWNED\a": "\\u001b]0;OWNED\\u0007",
    "a\x9b31mb": "a\\u009b31mb",
    "png\u202egnp.exe": "png\\u202egnp.exe",
    "\u2066x\u2069\u200f": "\\u2066x\\u2069\\u200f",
    "one\rtwo\x08\x7f": "one\\u000dtwo\\u0008\\u007f",
    "\udcff": "\\udcff",
    "\U000e0041": "\\udb40\\udc41",
    "\u2028": "\\u2028",
}


@pytest.mark.parametrize(("text", "shown"), HOSTILE.items())
def test_control_characters_are_escapes(text, shown):
    assert plain(text) == shown
    assert json.loads(plain(json.dumps(text, ensure_ascii=False))) == text.encode("utf-16", "surrogatepass").decode(
        "utf-16", "surrogatepass"
    )


@pytest.mark.parametrize("text", ["σ → 3 × 10⁻³ …", "日本 é ß עברית العربية", "a\tb\nc", "👩‍🔬", "[red] :bomb: {x}"])
def test_letters_of_all_languages_stay(text):
    assert plain(text) == text


def test_a_line_stays_a_line():
    assert plain_line("a\nb\tc\x1b") == "a\\nb\\tc\\u001b"


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "latin-1", "utf-8"])
def test_no_encoding_lacks_a_sign(encoding):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    ascii_signs(stream)
    stream.write("a → b, 3 × 5 px, σ 中 \udcff")
    stream.flush()
    written = stream.buffer.getvalue().decode(encoding)
    assert written.startswith("a → b, 3 × 5" if encoding == "utf-8" else "a -> b, 3 ")
    assert written.endswith("\\udcff")
    assert ("sigma \\u4e2d" in written) == (encoding != "utf-8")


def test_streams_that_are_closed_or_replaced_are_left_alone():
    ascii_signs(None)
    ascii_signs(io.StringIO())


class Screen(io.StringIO):
    """A terminal, or not."""

    def __init__(self, terminal):
        super().__init__()
        self.isatty = lambda: terminal


@pytest.mark.parametrize("text", HOSTILE)
@pytest.mark.parametrize("terminal", [False, True])
def test_names_in_progress_and_tables_are_escaped(monkeypatch, text, terminal):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", Screen(terminal))
    console = consoles()[1]
    assert console.is_terminal == terminal
    with Progress(console) as progress:
        progress.on_event(Event("checking", text=text, counts={"done": 1, "all": 2}))
        progress.on_event(Event("planned", stages={text: {"run": 1}}))
        progress.on_event(Event("dashboard", text=text))
        progress.on_event(Event("finished", task=text, stage=text, status="failed", text=text))
    console.print(simple_table((text, "n"), [(text, 1)]))
    shown = sys.stderr.getvalue()
    hostile = [sign for sign in text if plain(sign) != sign]
    assert plain(text) in shown
    if terminal:  # colours and the table that renews itself need sequences of their own
        hostile = [sign for sign in hostile if sign not in "\x1b\r"]
        assert "\x1b]" not in shown
    assert not [sign for sign in hostile if sign in shown]
