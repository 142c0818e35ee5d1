"""Pictures and tables in a folder: all there, left alone when up to date, drawn again when their source changed."""

from __future__ import annotations

import json

import pytest
from PIL import Image

from dicflow.errors import InputError
from dicflow.pipeline import Pipeline
from dicflow.views.publish import publish


@pytest.fixture
def result(pipeline, measured):
    return Pipeline.load(pipeline).result()


def stamps(files):
    return {path: path.stat().st_mtime_ns for path in files}


def test_all_pictures_and_tables_are_written(result, tmp_path):
    files = publish(result, tmp_path / "new")
    names = {path.relative_to(tmp_path / "new").as_posix() for path in files}
    drawn = {"maps/eyy_loading.png", "maps/eyy.gif", "maps/eyy/step_01.png", "maps/eyy/step_02.png"}
    assert names == {*drawn, "comparison.csv"}
    for name in drawn:
        with Image.open(tmp_path / "new" / name) as image:
            image.verify()
    assert {path for path in (tmp_path / "new").rglob("*") if path.is_file()} == {
        *files,
        tmp_path / "new/.published.json",
    }
    table = (tmp_path / "new" / "comparison.csv").read_text().splitlines()
    assert table[0].startswith("# dicflow ")


def test_what_is_up_to_date_is_left_alone(result, pipeline, measured):
    """The run that made the store has published beside it."""
    folder = pipeline.parent / "results" / pipeline.stem
    before = stamps(folder.rglob("*"))
    files = publish(result, folder)
    assert len(files) == 5
    assert stamps(folder.rglob("*")) == before


def test_the_same_result_gives_the_same_bytes_elsewhere(result, pipeline, measured, tmp_path):
    files = publish(result, tmp_path, workers=2)
    for path in files:
        there = pipeline.parent / "results" / pipeline.stem / path.relative_to(tmp_path)
        assert path.read_bytes() == there.read_bytes(), path.name


def test_only_what_is_missing_or_changed_is_made_again(result, tmp_path):
    files = publish(result, tmp_path)
    table, picture = tmp_path / "comparison.csv", tmp_path / "maps" / "eyy" / "step_01.png"
    before = stamps(files)
    table.unlink()
    publish(result, tmp_path)
    assert {path for path, stamp in stamps(files).items() if stamp != before[path]} == {table}
    manifest = tmp_path / ".published.json"
    made = json.loads(manifest.read_text())
    made["maps/eyy.gif"] = ["another release"]
    manifest.write_text(json.dumps(made))
    before = stamps(files)
    publish(result, tmp_path)
    again = {path for path, stamp in stamps(files).items() if stamp != before[path]}
    assert again == {path for path in files if path.suffix != ".csv"}
    assert picture in again


def test_a_damaged_list_of_what_was_made_makes_all_again(result, tmp_path):
    files = publish(result, tmp_path)
    contents = [path.read_bytes() for path in files]
    for damage in (b"", b"[1]", b"\xff"):
        (tmp_path / ".published.json").write_bytes(damage)
        assert [path.read_bytes() for path in publish(result, tmp_path)] == contents


def test_nothing_measured_nothing_published(pipeline, tmp_path):
    empty = Pipeline.load(pipeline, store=tmp_path / "store").result()
    assert publish(empty, tmp_path / "new") == []


def test_a_folder_that_cannot_be_made(result, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file: cannot be written \(a file stands where a folder should be\); name"):
        publish(result, tmp_path / "file")


def test_variants_have_folders_and_a_table(pipeline, measured, tmp_path):
    """Variants that share a product share its pictures."""
    loaded = Pipeline.load(pipeline, settings=["comparison.length=tracked,cloud"])
    files = publish(loaded.run(scheduler="sync"), tmp_path)
    names = {path.relative_to(tmp_path).as_posix() for path in files}
    assert {"sweep.csv", "sweep.png", "variant_1/comparison.csv", "variant_2/comparison.csv"} <= names
    assert {name for name in names if name.endswith(".gif")} == {"variant_1/maps/eyy.gif"}
    rows = (tmp_path / "sweep.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["comparison.length", "tracked", "cloud"]
