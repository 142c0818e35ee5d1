"""The reporting table: what is filled in agrees with the settings, what is left is marked."""

import pytest
import yaml
from small import ROOT, STEPS

from dicflow.kinds.images import Images
from dicflow.pipeline import Pipeline
from dicflow.report.context import Context
from dicflow.report.pieces import Pieces
from dicflow.report.reporting import Row, reporting_rows
from dicflow.report.settings import settings
from tests.pages import Page, context_of

BLANKS = {
    "cameras",
    "lenses",
    "aperture",
    "exposure time",
    "image acquisition rate",
    "lighting",
    "specimen",
    "material",
    "patterning technique",
    "noise floor and bias of every quantity",
}


def rows_of(loaded, folder):
    return {row.name: row for row in reporting_rows(context_of(loaded, folder))}


@pytest.fixture(scope="module")
def loaded(pipeline, measured):
    return Pipeline.load(pipeline)


@pytest.fixture(scope="module")
def rows(loaded, tmp_path_factory):
    return rows_of(loaded, tmp_path_factory.mktemp("rows"))


def test_rows_without_a_known_value_are_blank(rows):
    assert {name for name, row in rows.items() if row.value is None} == BLANKS
    assert all(row.hint for row in rows.values() if row.value is None)


def test_what_is_filled_in_is_as_set(loaded, rows):
    stages = yaml.safe_load(loaded.path.read_text())["stages"]
    resolved = loaded.resolved()["stages"]
    assert rows["features"].value.startswith(stages["features"]["detector"])
    assert rows["calibration target"].value == "checkerboard, 9 × 6, 14.5 mm"
    assert rows["step size"].value == f"{resolved['track']['step_size']:g} px"
    assert rows["strain window"].value == "80 × 20 px, degree 2"
    assert rows["number of steps"].value == str(STEPS)


def test_what_is_measured_agrees_with_the_truth(loaded, rows):
    rig = loaded.result().product("rig").attrs
    width, height = rig["rig"]["left"]["size"]
    assert rows["image size"].value == f"{width} × {height} px"
    scale = float(rows["image scale"].value.split()[0])
    stand_off = float(rows["stand-off distance"].value.split()[0])
    assert scale * stand_off == pytest.approx(rig["rig"]["left"]["matrix"][0][0], rel=1e-3)
    assert stand_off == pytest.approx(403, abs=5)
    assert rows["field of view"].value.startswith(f"{width / scale:.0f}"[:2])


def test_the_correlation_is_listed_with_its_reference_and_gauge(pipeline, tmp_path):
    path = tmp_path / "precise.yaml"
    lines = (ROOT / "pipelines" / "quickstart.yaml").read_text().splitlines(keepends=True)
    path.write_text("".join(line for line in lines if "stage: compare" not in line))  # it needs engineering strain
    loaded = Pipeline.load(path, data=pipeline.parent, settings=["correlation.subset_size=33", "total.measure=hencky"])
    rows = rows_of(loaded, tmp_path)
    assert rows["subset size"].value == "33 px"
    assert (
        rows["subset shape function"].value
        == "affine or, where needed, quadratic in time, quadratic from left to right"
    )
    assert rows["matching criterion"].value.endswith("(ZNSSD)")
    assert rows["reference image"].value.startswith("the first photograph; another")
    assert rows["strain measure"].value == "Hencky strain: ln λ along the principal directions"
    assert rows["virtual strain gauge (VSG)"].value == "not yet computed"


def test_one_camera_has_no_stereo_angle(pipeline, tmp_path):
    path = tmp_path / "planar.yaml"
    path.write_text((ROOT / "pipelines" / "planar.yaml").read_text())
    rows = rows_of(Pipeline.load(path, data=pipeline.parent), tmp_path)
    assert rows["number of cameras"].value == "1"


def test_blanks_are_marked_and_counted(loaded, tmp_path):
    section = settings(Context(loaded, loaded.result(), None, Pieces(tmp_path, "code"), tmp_path))
    page = Page(str(section.body))
    marked = [text for text in page.texts if text.startswith("fill in: ")]
    assert len(marked) == len(BLANKS)
    assert f"{len(BLANKS)} rows are left to fill in" in page.texts
    assert "cameras" in page.texts


def test_a_row_is_text(loaded, tmp_path, monkeypatch):
    monkeypatch.setattr("dicflow.report.settings.reporting_rows", lambda *_: [Row("<g>", "<b>", "1 < 2 & 3", "")])
    section = settings(Context(loaded, loaded.result(), None, Pieces(tmp_path, "code"), tmp_path))
    assert {"<g>", "<b>", "1 < 2 & 3"} <= set(Page(str(section.body)).texts)


def test_the_table_says_which_way_up_tagged_photographs_are(loaded, rows, tmp_path, monkeypatch):
    assert not [name for name in rows if name.startswith("orientation")]
    monkeypatch.setattr(Images, "notes", {"left": "turned by 90°"})
    assert rows_of(loaded, tmp_path)["orientation, left"].value == "turned by 90°"


def stated(copied, **facts):
    """The pipeline with a section ``report``."""
    document = yaml.safe_load(copied.read_text())
    copied.write_text(yaml.safe_dump({**document, "report": facts}, sort_keys=False))
    return Pipeline.load(copied)


def test_what_the_file_states_fills_the_blank_rows(copied, tmp_path):
    loaded = stated(
        copied,
        specimen="strip", material="latex", pattern="paint", camera="Mako", lens="25 mm", aperture="f/8",
        exposure="4 ms", rate="1 Hz", light="LED", operator="A. Noether", laboratory="Mechanics", remark="<b>wet</b>",
    )  # fmt: skip
    rows = rows_of(loaded, tmp_path)
    assert [name for name in BLANKS if rows[name].value is None] == ["noise floor and bias of every quantity"]
    assert (rows["lenses"].value, rows["lighting"].value, rows["operator"].value) == ("25 mm", "LED", "A. Noether")
    body = settings(context_of(loaded, tmp_path)).body
    assert "&lt;b&gt;wet" in body
    assert "1 row is left to fill in" in body


def test_stating_facts_leaves_all_that_was_computed(copied):
    keys = {name: entry.key for name, entry in Pipeline.load(copied).plan().entries.items()}
    loaded = stated(copied, operator="A. Noether")
    plan = loaded.plan()
    assert {name: entry.key for name, entry in plan.entries.items()} == keys
    assert loaded.last_run() is not None
