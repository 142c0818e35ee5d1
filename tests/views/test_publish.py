"""Pictures and tables in a folder: all there, left alone when up to date, drawn again when their source changed."""

from __future__ import annotations

import pytest
from PIL import Image

from dicflow.engine.stored_json import anything, read_stored, seal, unseal
from dicflow.errors import InputError
from dicflow.pipeline import Pipeline
from dicflow.views import published as module
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
    made = read_stored(manifest, anything)
    made["made"]["maps/eyy/step_01.png"][0] = made["result"] = "another release"
    manifest.write_bytes(seal(made))
    before = stamps(files)
    publish(result, tmp_path)
    assert {path for path, stamp in stamps(files).items() if stamp != before[path]} == {picture}


@pytest.mark.parametrize("name", ["maps/eyy/step_01.png", "maps/eyy.gif", "comparison.csv"])
@pytest.mark.parametrize("damage", [b"", b"\0" * 4000, None])
def test_a_damaged_file_is_made_again_and_never_shown(result, tmp_path, name, damage):
    """Also in the sheets and animations that are put together from the pictures."""
    publish(result, tmp_path)
    whole = contents(tmp_path)
    (tmp_path / name).write_bytes(whole[name][:-1] if damage is None else damage)
    (tmp_path / "maps" / "eyy_loading.png").unlink()
    publish(result, tmp_path)
    assert contents(tmp_path) == whole


def test_whoever_stops_the_drawing_keeps_what_is_drawn(result, tmp_path, monkeypatch):
    """Ctrl-C after the first of three parts; what is under way is finished, and the rest is drawn by the next call."""
    seen = []

    def stop(done, count):
        seen.append((done, count))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        publish(result, tmp_path, note=stop)
    drawn = stamps(tmp_path.rglob("*.png"))
    assert seen == [(1, 4)]
    assert 1 <= len(drawn) <= 2
    files = publish(result, tmp_path, note=lambda done, count: seen.append((done, count)))
    assert seen[1:] == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert {path: path.stat().st_mtime_ns for path in drawn} == drawn
    assert len(files) == 5


@pytest.mark.parametrize("writes", range(5))
def test_a_killed_process_leaves_nothing_that_counts_as_made(copied, result, tmp_path, monkeypatch, writes):
    """It dies at one of its five writes, and the settings go back to those of the files that it has replaced."""
    folder = tmp_path / "results"
    publish(result, folder)
    whole = contents(folder)
    changed = Pipeline.load(copied, settings=["maps.percentile=10"]).run(scheduler="sync")
    write, left = module.write_whole, [writes]

    def dying(path, content):
        if left[0] == 0:
            raise KeyboardInterrupt
        left[0] -= 1
        write(path, content)

    monkeypatch.setattr(module, "write_whole", dying)
    with pytest.raises(KeyboardInterrupt):
        publish(changed, folder)
    monkeypatch.undo()
    publish(result, folder)
    assert contents(folder) == whole


def test_a_picture_is_made_of_the_arrays_that_it_shows(copied, tmp_path):
    """Another window of the strain leaves the pictures of the displacement alone."""
    quantities, folder = "maps.quantities=[V, eyy]", tmp_path / "results"
    files = publish(Pipeline.load(copied, settings=[quantities]).run(scheduler="sync"), folder)
    before = stamps(files)
    other = Pipeline.load(copied, settings=[quantities, "strain.window=[60, 60]"]).run(scheduler="sync")
    assert publish(other, folder) == files
    again = {path.relative_to(folder).as_posix() for path, stamp in stamps(files).items() if stamp != before[path]}
    drawn = {f"maps/eyy{name}" for name in ("_loading.png", ".gif", "/step_01.png", "/step_02.png")}
    assert again == {*drawn, "comparison.csv"}


def test_a_damaged_list_of_what_was_made_makes_all_again(result, tmp_path):
    files = publish(result, tmp_path)
    contents = [path.read_bytes() for path in files]
    other = seal({"maps/eyy.gif": "0"})
    for damage in (b"\xff", b"[1]", b'{"maps/eyy.gif": 1}', b"[" * 100_000, other):
        (tmp_path / ".published.json").write_bytes(damage)
        assert [path.read_bytes() for path in publish(result, tmp_path)] == contents


@pytest.fixture
def shorter(copied):
    """The result of all steps but the last."""
    rows = (copied.parent / "caliper.csv").read_text().splitlines()
    (copied.parent / "shorter.csv").write_text("\n".join(rows[:-1]))
    photos = [f"photos.{side}='photos/{side}/step_0[01].png'" for side in ("left", "right")]
    return Pipeline.load(copied, settings=[*photos, "comparison.caliper=shorter.csv"]).run(scheduler="sync")


def contents(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_pictures_of_steps_that_are_gone_go(result, shorter, tmp_path):
    publish(result, tmp_path / "used")
    assert (tmp_path / "used" / "maps" / "eyy" / "step_02.png").exists()
    publish(shorter, tmp_path / "used")
    publish(shorter, tmp_path / "new")
    used, new = contents(tmp_path / "used"), contents(tmp_path / "new")
    assert unseal(used.pop(".published.json"), anything) == unseal(new.pop(".published.json"), anything)
    assert used == new


def test_files_of_others_stay(result, shorter, tmp_path):
    """Also one that has taken the place of a picture, and one that the list names by a detour."""
    publish(result, tmp_path / "o")
    manifest = tmp_path / "o" / ".published.json"
    made = read_stored(manifest, anything)
    made["made"]["maps/../../mine.png"] = made["made"]["maps/eyy/step_02.png"]
    manifest.write_bytes(seal(made))
    pictures = tmp_path / "o" / "maps" / "eyy"
    mine = [tmp_path / "mine.png", pictures / "note.txt", pictures / "step_03.png"]
    for path in mine:
        path.write_bytes((pictures / "step_02.png").read_bytes())
    (pictures / "step_02.png").write_bytes(b"annotated by hand")
    publish(shorter, tmp_path / "o")
    assert (pictures / "step_02.png").read_bytes() == b"annotated by hand"
    assert all(path.exists() for path in mine)


def test_nothing_measured_nothing_published(pipeline, tmp_path):
    empty = Pipeline.load(pipeline, store=tmp_path / "store").result()
    assert publish(empty, tmp_path / "new") == []


def test_a_folder_that_cannot_be_made(result, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file: cannot be written \(a file stands where a folder should be\); name"):
        publish(result, tmp_path / "file")


def test_variants_have_folders_and_a_table(copied, tmp_path):
    """Variants that share a product share its pictures."""
    loaded = Pipeline.load(copied, settings=["comparison.length=tracked,cloud"])
    files = publish(loaded.run(scheduler="sync"), tmp_path)
    names = {path.relative_to(tmp_path).as_posix() for path in files}
    assert {"sweep.csv", "sweep.png", "variant_1/comparison.csv", "variant_2/comparison.csv"} <= names
    assert {name for name in names if name.endswith(".gif")} == {"variant_1/maps/eyy.gif"}
    rows = (tmp_path / "sweep.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows] == ["comparison.length", "tracked", "cloud"]
