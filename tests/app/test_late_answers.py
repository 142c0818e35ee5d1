"""Answers that come late: the newest question is the one that is answered, and writes follow one another."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from app_browser import opened_page
from app_serving import FILE, served, small_test
from waiting import PATIENCE_S

from dicflow.io.configuration import read
from dicflow.io.region import read_geojson

pytestmark = pytest.mark.slow
SETTLED = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 20))))"


class Held:
    """The first answer to a question, held back. answered : how many answers came to the page before it"""

    def __init__(self, page: Any, question: str) -> None:
        self.page, self.address, self.kept, self.answered = page, f"**/ask/{question}", [], 0
        page.route(self.address, self._meet)

    def _meet(self, route: Any) -> None:
        response = route.fetch()
        if self.kept:
            self.answered += 1
            route.fulfill(response=response)
        else:
            self.kept.append((route, response))

    def until(self, condition: Any) -> None:
        """Wait until a condition holds."""
        end = time.monotonic() + PATIENCE_S
        while not condition(self):
            assert time.monotonic() < end, self.address
            self.page.wait_for_timeout(10)

    def give(self) -> None:
        """Let the first answer come, and the page show it if it does."""
        route, response = self.kept[0]
        route.fulfill(response=response)
        self.page.evaluate(SETTLED)


@contextmanager
def held_back(page: Any, question: str) -> Iterator[Held]:
    """Hold back the first answer to a question that is asked from now on."""
    held = Held(page, question)
    yield held
    page.unroute(held.address)


@pytest.fixture
def measured(small_result, tmp_path):
    """A folder with a small test that has been measured, and with another pipeline file."""
    folder = shutil.copytree(small_result.parent, tmp_path / "test")
    shutil.copy(folder / FILE, folder / "second.yaml")
    return folder


@pytest.fixture
def someone(measured):
    """Somebody at the page with the first of two pipeline files."""
    with served(measured / FILE) as app, opened_page(app) as person:
        yield person


def type_window(page, text):
    page.locator("label.parameter", has_text="window").first.locator("input").fill(text)
    page.keyboard.press("Tab")


def test_what_would_be_computed_is_that_of_the_newest_values(someone):
    page = someone.page
    page.click('#sidebar a[href="#settings/total"]')
    with held_back(page, "edit") as held:
        type_window(page, "wide")
        held.until(lambda one: one.kept)
        type_window(page, "50 px")
        page.wait_for_selector(".would")
        held.give()
        assert page.locator(".pending .problem").count() == 0
        assert page.inner_text(".would") == "total 2"


def test_values_that_were_discarded_are_not_offered_again(someone):
    page = someone.page
    page.click('#sidebar a[href="#settings/total"]')
    type_window(page, "50 px")
    page.wait_for_selector(".would")
    with held_back(page, "edit") as held:
        type_window(page, "60 px")
        held.until(lambda one: one.kept)
        type_window(page, "40 px")
        assert page.inner_text(".pending") == ""
        held.give()
        assert page.inner_text(".pending") == ""


def test_the_states_are_those_of_the_file_that_is_open(someone, measured):
    text = (measured / "second.yaml").read_text()
    (measured / "second.yaml").write_text(text.replace("window: 40 px", "window: 60 px"))
    page = someone.page
    page.wait_for_selector('#sidebar a.hit[href="#settings/total"]')
    with held_back(page, "plan") as held:
        page.click('#sidebar a[href="#settings"]')
        held.until(lambda one: one.kept)
        page.get_by_label("Pipeline file").select_option("second.yaml")
        page.wait_for_selector('#sidebar a.run[href="#settings/total"]')
        held.give()
        assert page.locator('#sidebar a.run[href="#settings/total"]').count() == 1


def test_a_screen_that_is_left_before_it_has_opened_asks_for_nothing_more(measured):
    with served(measured / FILE) as app, opened_page(app) as someone:
        page, asked = someone.page, []
        page.clock.install()
        page.on("request", lambda request: asked.append(request.url))
        with held_back(page, "watch") as held:
            page.click('#sidebar a[href="#run"]')
            held.until(lambda one: one.kept)
            someone.go("hand_over")
            page.wait_for_selector("text=Write the report")
            held.give()
        asked.clear()
        page.clock.fast_forward(20_000)
        page.evaluate("fetch('/static/icon.svg').then(() => null)")
        assert [url for url in asked if "/ask/" in url] == []


def test_facts_that_are_typed_quickly_are_all_written(someone, measured):
    page = someone.page
    someone.go("hand_over")
    facts = page.locator("label.fact textarea")
    with held_back(page, "edit") as held:
        facts.nth(0).fill("strip")
        page.keyboard.press("Tab")
        held.until(lambda one: one.kept)
        facts.nth(1).fill("two phones")
        page.keyboard.press("Tab")
        held.give()
        held.until(lambda one: one.answered == 1)
    page.wait_for_selector("text=/^2 of/")
    assert list(read(measured / FILE).data["report"].values()) == ["strip", "two phones"]
    assert page.locator(".message.error").count() == 0


@pytest.fixture
def folder(tmp_path):
    """A folder with a small test that has not been measured."""
    return small_test(tmp_path / "test").parent


@pytest.fixture
def drawing(folder):
    """Somebody at the screen on which its region is drawn."""
    with served(folder) as app, opened_page(app) as person:
        person.go("region")
        person.page.wait_for_selector(".path-name")
        yield person


def test_what_is_drawn_while_the_last_change_is_written_is_written_too(drawing, folder):
    page = drawing.page
    page.focus(".viewer")
    with held_back(page, "draw") as held:
        page.keyboard.press("h")
        for place in ((80, 60), (100, 60), (90, 80)):
            drawing.click(place)
        page.keyboard.press("f")
        held.until(lambda one: one.kept)
        page.keyboard.press("p")
        drawing.click((60, 100))
        held.give()
        drawing.said("saved: point_1")
    stages = read(folder / FILE).data["stages"]
    assert list(stages["probes"]["points"]) == ["point_1"]
    assert len(read_geojson(folder / stages["region"]["file"]).polygons[0].rings) == 2


def test_a_number_that_is_typed_while_the_last_one_is_written_is_kept(drawing, folder):
    page = drawing.page
    page.click(".path-name")
    with held_back(page, "draw") as held:
        page.get_by_label("x of corner 1").fill("25")
        page.keyboard.press("Tab")
        held.until(lambda one: one.kept)
        page.keyboard.type("3")
        held.give()
        page.wait_for_selector("text=saved: corner of outline")
        page.keyboard.type("0")
        page.keyboard.press("Tab")
        drawing.until("document.querySelectorAll('#messages .message').length === 2")
    assert read_geojson(folder / "region.geojson").polygons[0].exterior[0].tolist() == [25, 30]


def test_the_photograph_is_that_of_the_pair_that_was_chosen_last(sample_result):
    with served(sample_result) as app, opened_page(app) as someone:
        page = someone.page
        someone.go("calibration")
        names = page.locator(".pair-name")
        names.first.wait_for()
        shown = "document.querySelector('.viewer').viewer.photograph.key"
        someone.until(shown)
        first = page.evaluate(shown)
        with held_back(page, "photograph") as held:
            names.nth(1).click()
            held.until(lambda one: one.kept)
            names.nth(2).click()
            held.until(lambda one: one.answered == 1)
            someone.until(f"{shown} !== '{first}'")
            before = page.evaluate(shown)
            held.give()
            assert page.evaluate(shown) == before
