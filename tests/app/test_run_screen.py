"""Runs are processes of their own: started, watched, stopped and gone on with, whoever started them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import pytest
from app_browser import opened_page
from app_serving import FILE, served, small_test
from waiting import PATIENCE_S, started, until

from dicflow.app.project import open_project
from dicflow.app.runs import Runs
from dicflow.engine.journal import runs
from dicflow.engine.store import Store
from dicflow.errors import ConfigurationError
from dicflow.pipeline import Pipeline

pytestmark = pytest.mark.slow


def test_a_run_is_started_and_watched_to_its_end(tmp_path):
    path = small_test(tmp_path / "test", steps=3)
    with served(path.parent) as app, opened_page(app) as someone:
        someone.go("run")
        assert someone.page.inner_text("h1") == "Not run yet"
        someone.page.get_by_role("button", name="Start", exact=True).click()
        someone.said("started")
        someone.page.wait_for_selector("h1.state.done")
        found = app.found("watch", file=FILE)
        plan = Pipeline.load(path).plan()
        assert plan.counts["run"] == plan.counts["pending"] == 0
        assert {name: row["all"] for name, row in found["stages"].items()} == {
            stage: sum(counts.values()) for stage, counts in plan.by_stage().items()
        }
        assert all(row["computed"] == row["all"] for row in found["stages"].values())
        assert (newest := runs(Store.open(path.parent / ".dicflow"))[0]).id == found["run"]
        assert newest.id in someone.page.inner_text("section.run")
        someone.page.wait_for_selector('#sidebar a.hit[href="#settings/total"]')
        assert someone.overlaps() == []


def test_a_run_is_stopped_and_gone_on_with(tmp_path):
    path = small_test(tmp_path / "test", steps=40, size=(300, 220))
    with served(path) as app, opened_page(app) as someone:
        page = someone.page
        someone.go("run")
        page.get_by_role("button", name="Start", exact=True).click()
        page.wait_for_selector("h1.state.running")
        until(lambda: any(row["computed"] for row in app.found("watch", file=FILE).get("stages", {}).values()))
        again = app.ask("start", file=FILE)
        assert (again.status, "under way" in again.json["message"]) == (422, True)
        page.get_by_role("button", name="Stop").click()
        page.wait_for_selector("h1.state.stopped")
        stopped = app.found("watch", file=FILE)
        done = sum(row["computed"] for row in stopped["stages"].values())
        page.get_by_role("button", name="Go on").click()
        page.wait_for_selector("h1.state.done")
        found = app.found("watch", file=FILE)
    assert found["run"] != stopped["run"]
    assert sum(row["hit"] for row in found["stages"].values()) >= done > 0


def test_a_run_of_a_terminal_is_seen_and_stopped(tmp_path):
    path = small_test(tmp_path / "test", steps=24, size=(300, 220))
    known = Runs(open_project(path))
    assert known.watch(FILE)["state"] == "none"
    with pytest.raises(ConfigurationError, match="no run"):
        known.stop(FILE)
    with started([sys.executable, "-m", "dicflow", "run", path], stderr=subprocess.DEVNULL) as process:
        until(lambda: any(row["computed"] for row in known.watch(FILE).get("stages", {}).values()))
        known.stop(FILE)
        assert process.wait(PATIENCE_S) != 0
    assert known.watch(FILE)["state"] == "stopped"


def test_what_failed_is_said_as_the_command_line_says_it(tmp_path):
    path = small_test(tmp_path / "test")
    path.write_text(path.read_text().replace("subset_size: 21", "subset_size: 5"))
    command = subprocess.run([sys.executable, "-m", "dicflow", "run", path], capture_output=True, text=True)
    assert command.returncode == 1
    with served(path.parent) as app, opened_page(app) as someone:
        someone.go("run")
        someone.page.wait_for_selector("h1.state.failed")
        (said,) = app.found("watch", file=FILE)["failures"]
        assert said["text"] in command.stderr
        assert said["text"] in someone.page.inner_text(".card.bad")
        someone.page.wait_for_selector('#sidebar a.failed[href="#settings/correlation"]')


def test_a_run_that_cannot_begin_says_why(tmp_path):
    path = small_test(tmp_path / "test")
    (path.parent / "left" / "step_0001.png").write_bytes(b"no photograph")
    known = Runs(open_project(path))
    known.start(FILE)
    message = until(lambda: known.watch(FILE)["message"])
    assert "step_0001.png" in message
    assert "Traceback" not in message


def test_runs_are_listed_pinned_and_cleaned_up(tmp_path):
    path = small_test(tmp_path / "test")
    ids = [Pipeline.load(path).run(scheduler="sync").outcome.run_id for _ in range(2)]
    with served(path.parent) as app, opened_page(app) as someone:
        someone.go("run")
        page = someone.page
        page.wait_for_selector(f"text={ids[1]}")
        row = page.locator("tr", has_text=ids[0])
        row.locator("button").click()
        page.wait_for_selector("button[aria-pressed=true]")
        assert {run["id"]: run["pin"] for run in app.found("runs", file=FILE)} == {ids[0]: "", ids[1]: None}
        files = [path for path in (path.parent / ".dicflow").rglob("*") if path.is_file()]
        assert app.found("disk", file=FILE) == sum(file.stat().st_size for file in files)
        page.click("text=What would go?")
        page.wait_for_selector("text=would free 0.0 MB: 0 products, 0 runs")
        page.wait_for_selector("text=MB on the disk")


def test_what_is_not_kept_is_deleted(small_result, tmp_path):
    """Products of other settings go with their run; those of the pinned run stay, byte for byte."""
    path = shutil.copytree(small_result.parent, tmp_path / "test") / FILE
    store = path.parent / ".dicflow"
    with served(path.parent) as app, opened_page(app) as someone:
        (first,) = [run["id"] for run in app.found("runs", file=FILE)]
        app.found("pin", file=FILE, run=first, note="the good one")
        before = {one: one.read_bytes() for one in store.rglob("*") if one.is_file() and "objects" in one.parts}
        path.write_text(path.read_text().replace("window: 40 px", "window: 60 px"))
        assert Pipeline.load(path).run(scheduler="sync").outcome.ok
        path.write_text(path.read_text().replace("window: 60 px", "window: 40 px"))
        added = {one for one in store.rglob("*") if one.is_file() and "objects" in one.parts} - set(before)
        assert added
        for one in store.rglob("*"):  # what is young stays
            os.utime(one, (1e9, 1e9))
        someone.go("run")
        page, asked = someone.page, []
        page.on("request", lambda request: asked.append(request.url))
        for count in ("", "-1", "0"):
            page.get_by_label("newest runs that keep their products").fill(count)
            page.click("text=What would go?")
        page.wait_for_selector("text=would free")
        assert sum(url.endswith("/ask/clean") for url in asked) == 1
        assert all(one.exists() for one in added)
        someone.picture("clean_up_1280")
        assert someone.overlaps() == []
        page.click("text=Delete them")
        someone.until("document.querySelectorAll('section.run td.id').length === 1")
        assert page.inner_text("section.run td.id") == first
        assert not any(one.exists() for one in added)
        assert {one: one.read_bytes() for one in before} == before
    assert Pipeline.load(path).plan().counts["run"] == 0
