"""What the terminal shows: progress, plans and tables, with brackets as they are."""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from rich.console import Console

from dicflow.engine.journal import Event
from dicflow.engine.product import Product, Variable
from dicflow.views.console import consoles, product_tables, simple_table
from dicflow.views.progress import Progress

STAGES = {"photos": {"hit": 2, "run": 0, "pending": 0}, "pair": {"hit": 0, "run": 2, "pending": 0}}


def finished(stage, number, status, text="", seconds=0.5):
    name = f"{stage}/step_{number}"
    return Event("finished", task=name, stage=stage, step=f"step_{number}", status=status, seconds=seconds, text=text)


def printed(events, terminal=False, before=()):
    """What a run with these events leaves on the screen. before : events before the plan"""
    buffer = io.StringIO()
    console = Console(file=buffer, force_terminal=terminal, width=120, markup=False, highlight=False)
    with Progress(console) as progress:
        for event in before:
            progress.on_event(event)
        progress.on_event(Event("planned", counts={}, stages=STAGES))
        for event in events:
            progress.on_event(event)
    return plain(buffer.getvalue())


def plain(text):
    """The text without a terminal's control sequences."""
    return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", text)


def test_a_line_per_stage_that_is_done():
    assert printed([finished("pair", 0, "computed")]) == ""
    assert printed([finished("pair", 0, "computed"), finished("pair", 1, "computed")]) == "pair: 2 computed, 1.0 s\n"


def test_a_failure_is_printed_with_its_brackets_and_what_is_skipped_is_not():
    lines = printed([finished("pair", 0, "failed", "pair/step_0: give [x, y]"), finished("pair", 1, "skipped")])
    assert lines == "pair/step_0: give [x, y]\n"


def test_the_dashboards_link_is_printed_and_warnings_are_left_to_the_last_lines():
    events = [Event("warning", text="surface: [rad] changed"), Event("dashboard", text="http://127.0.0.1:1/[x]")]
    assert printed(events) == "http://127.0.0.1:1/[x]\n"


def test_a_terminal_shows_counts_and_the_time_left():
    shown = printed([finished("pair", 0, "computed")], terminal=True)
    last = shown[shown.rindex("stage") :]
    assert re.search(r"photos\s+2\s+·\s+·\s+·\s+·\s+0\.0", last)
    assert re.search(r"pair\s+·\s+1\s+·\s+·\s+1\s+0\.5", last)
    assert re.search(r"\d+ s, about \d+ s left", last)


def checking(done):
    return Event("checking", text="files", counts={"done": done, "all": 12_000})


def test_what_is_checked_is_a_line_that_gives_way_to_the_table():
    shown = printed([], terminal=True, before=[checking(6_000)])
    assert "checking" not in shown[shown.rindex("stage") :]
    assert printed([], before=[checking(6_000)]) == ""


def test_a_plan_without_a_run_leaves_nothing_on_the_screen():
    buffer = io.StringIO()
    with Progress(Console(file=buffer, force_terminal=True, width=120)) as progress:
        progress.on_event(checking(6_000))
        progress._live.refresh()
    line, rest = buffer.getvalue().split("checking files: 6,000 of 12,000")
    assert plain(line) == ""
    assert plain(rest).strip() == ""


def test_output_to_a_file_is_neither_folded_nor_interpreted(capsys):
    out, err = consoles()
    out.print("[rad] " + "word " * 100, soft_wrap=True)
    out.print(simple_table(("what", "value"), [("a [b]", 1.5), ("c" * 150, 20.25)]))
    err.print("[x]")
    printed = capsys.readouterr()
    lines = printed.out.splitlines()
    assert lines[0].startswith("[rad] word")
    assert lines[2].split() == ["a", "[b]", "1.5"]
    assert lines[3].split() == ["c" * 150, "20.25"]
    assert printed.err == "[x]\n"


@pytest.mark.parametrize(
    ("values", "row"),
    [
        ([1.0, np.nan, 4.0], ["a", "mm", "float64", "3", "row", "1", "2.5", "4"]),
        ([np.nan, np.nan], ["a", "mm", "float64", "2", "row", "nan", "nan", "nan"]),
        ([], ["a", "mm", "float64", "0", "row", "nan", "nan", "nan"]),
    ],
)
def test_ranges_leave_out_what_is_missing(capsys, values, row):
    product = Product("thing", {"a": Variable(("row",), np.array(values, float), "mm")}, {"measure": "angle [rad]"})
    table, attrs = product_tables(product)
    consoles()[0].print(table)
    assert capsys.readouterr().out.splitlines()[1].split() == row
    assert attrs == '{\n "measure": "angle [rad]"\n}'
