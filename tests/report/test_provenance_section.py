"""Graph, times, versions and keys of a run."""

import pytest
import yaml
from small import TASKS

from dicflow.engine.journal import find_run
from dicflow.engine.records import versions
from dicflow.pipeline import Pipeline
from dicflow.pipeline.provenance import run_facts
from dicflow.report.context import Context
from dicflow.report.pieces import Pieces
from dicflow.report.provenance import provenance
from tests.pages import Page


@pytest.fixture(scope="module")
def loaded(pipeline, measured):
    return Pipeline.load(pipeline)


@pytest.fixture(scope="module")
def facts(loaded):
    return run_facts(loaded.store, find_run(loaded.store))


def section_of(loaded, facts, folder):
    return provenance(Context(loaded, loaded.result(), facts, Pieces(folder, "code"), folder))


def test_hits_and_computed_are_all_tasks_and_time_saved_is_of_the_hits(loaded, facts, tmp_path):
    """Records keep whole microseconds, the journal what the clock gave."""
    assert sum(facts.counts.values()) == TASKS == len(loaded.graph.tasks)
    tasks = tuple(task._replace(status="hit") if task.stage == "corners" else task for task in facts.tasks)
    run = facts._replace(tasks=tasks)
    records = [loaded.store.record(task.key).made["stage_s"] for task in tasks if task.status == "hit"]
    assert run.saved_s == pytest.approx(sum(records), abs=1e-6 * len(records))
    page = Page(str(section_of(loaded, run, tmp_path).body))
    assert page.text.count(f"{sum(records):.1f} s") >= 1
    assert any(f"all {TASKS} tasks" in text for text in page.texts)


@pytest.mark.parametrize("status", ["hit", "computed", "failed", "skipped"])
def test_boxes_carry_what_became_of_their_stage(loaded, facts, tmp_path, status):
    tasks = tuple(task._replace(status=status) if task.stage == "rig" else task for task in facts.tasks)
    body = str(section_of(loaded, facts._replace(tasks=tasks), tmp_path).body)
    assert body.count(f'<g class="stage {status}">') == (len(loaded.graph.stages) if status == "computed" else 1)
    assert "xmlns" not in body


def test_without_a_run_the_graph_shows_what_the_store_holds(loaded, tmp_path):
    page = Page(str(section_of(loaded, None, tmp_path).body))
    assert any("has not been run" in text for text in page.texts)
    assert page.text.count("in the store") == len(loaded.graph.stages)
    assert "Stages" not in page.texts


def test_the_settings_can_be_read_back(loaded, facts, tmp_path):
    body = str(section_of(loaded, facts, tmp_path).body)
    written = Page(body[body.index("<pre>") : body.index("</pre>") + 6])
    assert "surface:" in written.text
    text = body[body.index("<pre>") + 5 : body.index("</pre>")].replace("&#39;", "'").replace("&amp;", "&")
    assert yaml.safe_load(text) == loaded.resolved()


def test_another_version_is_a_warning(loaded, facts, tmp_path):
    assert section_of(loaded, facts, tmp_path).warnings == ()
    other = facts._replace(versions={**facts.versions, "numpy": ("1.0", versions()["numpy"])})
    assert section_of(loaded, other, tmp_path).warnings == (
        "Products were made by another version of numpy than is here.",
    )
