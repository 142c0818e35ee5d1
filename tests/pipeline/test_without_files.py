"""A store and a pipeline file whose photographs and tables are elsewhere: all that is stored can still be had."""

import json
import shutil

import pytest
from small import STEPS, dicflow

from dicflow.comparison.difference import compare
from dicflow.comparison.sides import open_sides
from dicflow.engine.references import cache
from dicflow.errors import InputError, NotKeptError
from dicflow.pipeline import Pipeline
from tests.pages import Page


@pytest.fixture
def alone(copied):
    """A pipeline file and its store, without any file that the pipeline names."""
    for path in copied.parent.iterdir():
        if path.name not in (copied.name, ".dicflow"):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    cache.clear()
    return copied


def test_the_result_is_that_of_the_last_run(alone, pipeline, measured):
    whole, found = Pipeline.load(pipeline).result(), Pipeline.load(alone).result()
    assert found.digests == whole.digests
    assert found.steps("total") == whole.steps("total")
    assert (whole.notes, len(found.notes)) == ((), 1)
    assert f"of the files in '{pipeline.parent.name}'" in found.notes[0]
    assert "no photograph matches" in found.notes[0]
    assert all(found.has("total", step) for step in found.steps("total"))
    assert found.has("comparison")
    assert not found.has("photos", 0)
    with pytest.raises(NotKeptError, match="was not kept"):
        found.product("photos", 0)["left"]


def test_a_caliper_table_that_is_broken_hinders_nobody(copied):
    (table,) = copied.parent.glob("*.csv")
    table.write_text("nonsense")
    found = Pipeline.load(copied).result()
    assert found.has("comparison")
    assert table.name in found.notes[0]


def test_exports_are_the_same_files(alone, pipeline, measured, tmp_path):
    whole = dicflow("export", pipeline, "--output", tmp_path / "whole")
    answer = dicflow("export", alone, "--output", tmp_path / "alone")
    assert (whole.code, answer.code) == (0, 0), answer.err
    assert whole.err == ""
    assert answer.err.count("warning: This is what run ") == 1
    files = {path.name: path.read_bytes() for path in (tmp_path / "whole").iterdir()}
    assert {path.name: path.read_bytes() for path in (tmp_path / "alone").iterdir()} == files
    chosen = ("total", "--step", "step_02", "--quantity", "eyy", "--format", "png", "--output", tmp_path / "drawn")
    assert dicflow("export", alone, *chosen).code == 0
    assert (tmp_path / "drawn" / "total_step_02_eyy.png").read_bytes().startswith(b"\x89PNG")


def test_the_report_has_its_fields_and_why_photographs_are_missing(alone, tmp_path):
    answer = dicflow("report", alone, "--output", tmp_path / "results")
    assert answer.code == 0, answer.err
    assert answer.err.count("This is what run ") == 1
    page = Page.read(tmp_path / "results" / "report.html")
    page.assert_complete()
    assert {"summary", "calibration", "answer", "quality", "settings", "provenance"} <= set(page.ids)
    assert f"photos: 0 of {STEPS}" in page.texts
    assert f"total: {STEPS - 1} of {STEPS - 1}" in page.texts
    assert "This is what run " in page.text
    assert str(alone.parent) not in page.text
    data = (tmp_path / "results" / "report.html").read_text().partition('id="explorer-manifest">')[2]
    manifest = json.loads(data.partition("</script>")[0])
    assert [step["photos"] for step in manifest["steps"]] == [{}] * (STEPS - 1)
    assert "neither in the store nor in their folder" in " ".join(manifest["left_out"])
    assert all("value/eyy" in step["blobs"] for step in manifest["steps"])


def test_pictures_that_lie_beside_the_page_are_used_again(copied, tmp_path):
    dicflow("report", copied, "--output", tmp_path / "results")
    shutil.rmtree(copied.parent / "photos")
    assert dicflow("report", copied, "--output", tmp_path / "results").code == 0
    page = (tmp_path / "results" / "report.html").read_text()
    assert "This is what run " in page
    assert "neither in the store nor in their folder" not in page


def test_a_comparison_names_the_origin_of_its_side(alone, pipeline, measured):
    found = compare(*open_sides(str(alone), str(pipeline)))
    assert not found.differs
    assert [note for note in found.notes if note.startswith("This is what run ")]


def test_what_was_never_run_needs_its_files(alone):
    with pytest.raises(InputError, match="no photograph matches"):
        Pipeline.load(alone, settings=["strain.window=[61, 61]"]).result()
    dicflow("run", alone).refuses(2, "no photograph matches")
