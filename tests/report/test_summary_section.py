"""What came out, with what to be careful about before it."""

import pytest
from small import STEPS, TASKS

from dicflow.core.status import Status
from dicflow.engine.journal import find_run
from dicflow.pipeline import Pipeline
from dicflow.pipeline.provenance import RunWarning, run_facts
from dicflow.report import summary as module
from dicflow.report.context import Context, Section
from dicflow.report.history import step_history
from dicflow.report.pieces import Pieces
from dicflow.report.summary import summary
from tests.pages import Page


@pytest.fixture(scope="module")
def loaded(pipeline, measured):
    return Pipeline.load(pipeline)


@pytest.fixture
def context(loaded, tmp_path):
    facts = run_facts(loaded.store, find_run(loaded.store))
    return Context(loaded, loaded.result(), facts, Pieces(tmp_path, "code"), tmp_path)


def page_of(context, sections=()):
    return Page(str(summary(context, sections).body))


def test_the_table_has_the_caliper_beside_what_was_measured(loaded, context):
    rows, history = loaded.result().product("comparison").attrs["rows"], step_history(context)
    assert history.phases == tuple(row["phase"] for row in rows)
    for key in ("load_g", "caliper_length_mm", "dic_length_mm", "dic_strain", "strain_error_pct"):
        assert history.values[key] == tuple(row[key] for row in rows)
    assert len(history.steps) == STEPS
    units = {column.key: (column.title, column.unit) for column in history.columns}
    assert units["dic_strain"] == ("strain, DIC", "1")
    assert units["load_g"] == ("load", "g")


def test_the_share_of_points_counts_those_of_the_region(loaded, context):
    shares = step_history(context).valid_share
    assert shares[0] is None
    for step, share in zip(loaded.result().steps("total"), shares[1:], strict=True):
        status = loaded.result().product("total", step)["status"]
        inside = status[status != Status.OUTSIDE]
        assert share == pytest.approx((inside <= Status.FILLED).mean())
    assert all(0.5 < share <= 1 for share in shares[1:])


def test_lengths_that_are_not_alike_are_not_compared(loaded, context, monkeypatch):
    rows = [dict(row) for row in loaded.result().product("comparison").attrs["rows"]]
    for row in rows:
        del row["displacement_error_mm"]
    monkeypatch.setattr("dicflow.report.history._comparison", lambda result: rows)
    history = step_history(context)
    assert "only their strains compare" in history.remark
    assert {key for key in history.drawn if key.endswith("_mm")} == set()
    assert {"caliper_strain", "dic_strain"} <= set(history.drawn)


def test_uncertainties_of_extensometers_stand_in_the_table_alone(context, monkeypatch):
    readings = {f"E · {name}": (0.0,) * STEPS for name in ("length", "u_length", "strain", "u_strain")}
    monkeypatch.setattr("dicflow.report.history._comparison", lambda result: [])
    monkeypatch.setattr("dicflow.report.history._extensometers", lambda result: readings)
    history = step_history(context)
    assert [column.key for column in history.columns] == [*readings]
    assert history.drawn == ("E · length", "E · strain")


def test_warnings_stand_before_everything_else(context):
    sections = [Section("calibration", "Calibration", "", ("The <rig> is bad.",))]
    run = context.run._replace(warnings=(RunWarning("images", f"{context.pipeline.folder}/photos: dark"),))
    page = page_of(context._replace(run=run), sections)
    assert page.texts[:3] == ["photos: dark", "Calibration", ": The <rig> is bad."]
    assert "#calibration" in page.references


def test_few_points_are_a_warning(context, monkeypatch):
    history = step_history(context)._replace(valid_share=(None, 0.95, 0.42))
    monkeypatch.setattr(module, "step_history", lambda _: history)
    found = summary(context, [])
    lost = f"1 step has a value at less than 90.0 % of the points, {history.steps[2]} at 42.0 % only."
    assert found.warnings[-1] == lost


def test_warnings_of_a_stage_that_a_section_covers_are_not_repeated(context):
    sections = [Section("calibration", "Calibration", "", ("The calibration is poor.",), ("rig",))]
    warnings = RunWarning("rig", "rig: poor"), RunWarning("rig@2", "rig@2: poor"), RunWarning("", "tcp: poor")
    page = page_of(context._replace(run=context.run._replace(warnings=warnings)), sections)
    assert page.texts[:4] == ["rig@2: poor", "tcp: poor", "Calibration", ": The calibration is poor."]


def test_failed_tasks_and_what_was_skipped_for_them(context):
    tasks = tuple(
        task._replace(status="failed", error=f"rig: {context.pipeline.folder}/x: <no>")
        if task.task == "rig"
        else task._replace(status="skipped")
        if task.stage == "total"
        else task
        for task in context.run.tasks
    )
    page = page_of(context._replace(run=context.run._replace(tasks=tasks)))
    assert page.texts[0] == f"1 of {TASKS} tasks failed, and {STEPS - 1} were skipped for it."
    assert page.texts[1:4] == ["What failed", "rig", ": x: <no>"]
    assert f"missing: total ({STEPS - 1})." in page.text


def test_many_failures_are_not_all_listed(context):
    tasks = tuple(task._replace(status="failed", error="no") for task in context.run.tasks)
    page = page_of(context._replace(run=context.run._replace(tasks=tasks)))
    assert page.texts.count(": no") == 20
    assert f"… and {TASKS - 20} more tasks." in page.texts


def test_the_plots_are_made_once(context, monkeypatch):
    page_of(context)
    monkeypatch.setattr("dicflow.views.load_curve.load_curves", None)
    page = page_of(context)
    assert {"displacement [mm]", "strain [–]", "load [g]"} <= set(page.texts)


def test_the_largest_strain_is_named_with_its_step(loaded, context):
    rows = loaded.result().product("comparison").attrs["rows"]
    largest = max(range(STEPS), key=lambda index: rows[index]["dic_strain"])
    page = page_of(context)
    place = page.texts.index("Largest strain, DIC")
    assert float(page.texts[place + 1]) == pytest.approx(rows[largest]["dic_strain"], rel=1e-3)
    assert page.texts[place + 2] == f"at {step_history(context).steps[largest]}"
