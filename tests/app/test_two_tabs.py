"""Two tabs and an editor change the same files: each sees the changes of the others, and nothing of theirs is lost."""

from __future__ import annotations

import json
import os
import threading

import numpy as np
import pytest
from app_browser import opened_page
from app_serving import FILE, served, small_test

from dicflow.io.configuration import read
from dicflow.io.region import read_geojson

pytestmark = pytest.mark.slow
OUTER = [(30, 25), (170, 28), (165, 120), (35, 118)]
COMES_BACK = "dispatchEvent(new Event('focus'))"
"""What a browser does when somebody comes back to a tab."""


@pytest.fixture
def tabs(tmp_path):
    """The folder, and one person at two tabs, both on the region screen."""
    folder = small_test(tmp_path / "test").parent
    with served(folder) as app, opened_page(app) as one:
        one.go("region")
        other = one.tab()
        for tab in (one, other):
            tab.page.wait_for_selector(".path-name")
        yield folder, one, other
        assert other.errors == []


def draw(tab, key, places, end=""):
    """Draw a path with the tool of a key."""
    tab.page.bring_to_front()
    tab.page.focus(".viewer")
    tab.page.keyboard.press(key)
    for place in places:
        tab.click(place)
    if end:
        tab.page.keyboard.press(end)


def points(folder):
    return list(read(folder / FILE).data["stages"].get("probes", {}).get("points", {}))


def save_as_an_editor(path, text):
    """Replace a file as editors do."""
    path.with_suffix(".swp").write_text(text)
    os.replace(path.with_suffix(".swp"), path)


def test_a_tab_with_an_old_file_overwrites_nothing_and_shows_what_is_there(tabs):
    folder, one, other = tabs
    draw(one, "p", [(60, 60)])
    one.said("saved: point_1")
    draw(other, "p", [(120, 90)])
    other.said("changed meanwhile")
    assert points(folder) == ["point_1"]
    other.until("document.querySelectorAll('.path-name').length === 2")
    draw(other, "p", [(120, 90)])
    other.said("saved: point_2")
    assert points(folder) == ["point_1", "point_2"]
    one.page.keyboard.press("Control+z")
    one.said("changed meanwhile")
    assert points(folder) == ["point_1", "point_2"]
    one.until("document.querySelectorAll('.path-name').length === 3")
    one.page.keyboard.press("Control+z")
    one.said("taken back: probes")
    assert points(folder) == ["point_1"]
    other.page.evaluate(COMES_BACK)
    other.said("was changed by another program or page")
    other.until("document.querySelectorAll('.path-name').length === 2")
    other.page.keyboard.press("Control+y")
    other.said("made again: probes")
    assert points(folder) == ["point_1", "point_2"]


def test_a_value_typed_over_what_an_editor_saved_is_refused_and_typed_again(tabs):
    folder, one, other = tabs
    path = folder / FILE
    first = path.read_text()

    def type_window():
        one.page.bring_to_front()
        one.page.locator("label.parameter", has_text="window").first.locator("input").fill("50 px")
        one.page.keyboard.press("Tab")
        one.page.wait_for_selector(".would")
        one.page.click("text=Save to the file")

    one.page.click('#sidebar a[href="#settings/total"]')
    one.page.wait_for_selector(".parameter")
    edited = first.replace("subset_size: 21", "subset_size: 25")
    save_as_an_editor(path, edited)
    type_window()
    one.said("changed meanwhile")
    assert path.read_text() == edited
    type_window()
    one.said("saved: total.window")
    both = edited.replace("window: 40 px", "window: 50 px")
    assert path.read_text() == both
    other.page.evaluate(COMES_BACK)
    other.said("was changed by another program or page")
    other.page.keyboard.press("Control+z")
    other.said("taken back: total.window")
    assert path.read_text() == edited


def test_a_region_that_an_editor_has_changed_is_kept(tabs):
    folder, one, other = tabs
    one.page.click(".path-name")
    draw(one, "h", [(80, 60), (110, 62), (95, 90)], "f")
    one.said("saved: hole")
    path = folder / "region.geojson"
    found = json.loads(path.read_text())
    found["coordinates"][0][0][1] = [150.0, 20.0]
    save_as_an_editor(path, json.dumps(found))
    draw(other, "c", [(40, 40), (70, 45)], "f")
    other.said("changed meanwhile")
    one.page.bring_to_front()
    one.page.evaluate("document.querySelector('.viewer').isOld = true")
    one.drag((20, 130), (30, 120))
    one.said("changed meanwhile")
    assert json.loads(path.read_text()) == found
    one.until("!document.querySelector('.viewer').isOld")
    one.drag((20, 130), (30, 120))
    one.said("saved: corner")
    (polygon,) = read_geojson(path).polygons
    assert np.abs(polygon.exterior - [(20, 20), (150, 20), (180, 130), (30, 120)]).max() < 1.0
    assert len(polygon.holes) == 1


def test_changes_at_the_same_moment_are_all_there(tmp_path):
    """Tabs that ask at once, and ask again when they are refused, lose none of their changes."""
    folder = small_test(tmp_path / "test").parent
    refused = []

    def fill(app, tab, count=12):
        for number in range(count):
            while True:
                document = app.found("document", file=FILE)
                place = ["report", "remark"] if number == 0 else ["stages", f"total_{tab}_{number}"]
                value = "by two tabs" if number == 0 else {"stage": "deformation", "points": "correlation"}
                edits = [{"place": place, "value": value}]
                answer = app.ask("edit", file=FILE, digest=document["digest"], edits=edits, words="x")
                if answer.status == 200:
                    break
                assert answer.status == 409, answer.body
                refused.append(place)

    with served(folder) as app:
        threads = [threading.Thread(target=fill, args=(app, tab)) for tab in "abc"]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    stages = read(folder / FILE).data["stages"]
    assert sum(name.startswith("total_") for name in stages) == 3 * 11
    assert refused
