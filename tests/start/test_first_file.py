"""The first pipeline file for a folder: pairs, boards and their size are found, and what is written runs."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from small import BOARDS, STEPS, dicflow

from dicflow.core.calibration.board import Board
from dicflow.errors import ConfigurationError
from dicflow.io.configuration import parse
from dicflow.pipeline import Pipeline
from dicflow.stages.images import Images
from dicflow.start.first_file import OPEN, pipeline_text
from dicflow.start.folder import Caliper, Found, Photographs
from dicflow.start.gauge import Gauge
from dicflow.start.ways import Way

SAMPLES = Path(__file__).parents[2] / "data_samples"


@pytest.fixture(scope="module")
def photographs(pipeline):
    return pipeline.parent


@pytest.fixture(scope="module")
def stereo(photographs, tmp_path_factory):
    """A folder of both cameras, and the answer of init."""
    folder = tmp_path_factory.mktemp("init") / "stereo"
    shutil.copytree(photographs, folder, ignore=shutil.ignore_patterns("*.yaml", "truth", ".dicflow", "results"))
    return folder, dicflow("init", folder, "--square", "1.45 cm")


def test_findings_are_listed(stereo):
    folder, answer = stereo
    assert answer.code == 0, answer.err
    said = answer.out.splitlines()
    assert said[0] == f"specimen: {STEPS} pairs, photos/left/*.png and photos/right/*.png"
    assert said[1].startswith(f"boards: {BOARDS} pairs, boards/left/*.png and boards/right/*.png")
    assert "checkerboard of 9 × 6" in said[1]
    assert said[2] == "caliper table: caliper.csv"
    assert said[3].startswith("load along y: ")
    assert said[4] == f"wrote {folder}/pipeline.yaml; read it, then: dicflow run {folder}/pipeline.yaml"


def test_the_file_is_valid_and_shares_products_with_the_quick_start(stereo, measured, tmp_path):
    """Photographs, boards and rig are the same stages on the same files, so nothing of them is computed."""
    folder, _ = stereo
    store = shutil.copytree(measured, tmp_path / "store")
    loaded = Pipeline.load(folder / "pipeline.yaml", store=store)
    assert loaded.graph.stages["rig"].node.square == 14.5
    states = loaded.plan().by_stage()
    assert all(states[stage]["run"] == states[stage]["pending"] == 0 for stage in ("photos", "boards", "corners"))
    comments = [line for line in (folder / "pipeline.yaml").read_text().splitlines() if "#" in line]
    assert len(comments) >= 5
    result = loaded.run(scheduler="sync")
    assert result.outcome.ok, result.outcome.errors
    assert result.product("compare").attrs["length"] == "extensometer"
    rows = result.product("compare").attrs["rows"]
    assert rows[-1]["dic_strain"] == pytest.approx(rows[-1]["caliper_strain"], rel=0.005)


def test_an_existing_file_is_kept(stereo):
    folder, _ = stereo
    before = (folder / "pipeline.yaml").read_bytes()
    dicflow("init", folder).refuses(2, "pipeline.yaml exists; add --force to overwrite it")
    dicflow("init", folder, "--square", "3 px", "--force").refuses(2, "--square: '3 px' is not a quantity in mm")
    dicflow("init", folder, "--square", "14,5 mm", "--force").refuses(2, "write '14.5 mm', with a point")
    assert (folder / "pipeline.yaml").read_bytes() == before


@pytest.mark.slow
def test_cameras_mixed_in_one_folder_are_settled_by_a_short_command(tmp_path):
    """Names and counters of two cameras, no time, and the boards before the specimen; a bare square is in mm."""
    for side, name in (("left", "IMG_{:04}.PNG"), ("right", "P{:07}.png")):
        files = [path for part in ("boards", "photos") for path in sorted((SAMPLES / part / side).iterdir())]
        for k, path in enumerate(files):
            shutil.copy(path, tmp_path / name.format(k + 12))
    shutil.copy(tmp_path / "IMG_0013.PNG", tmp_path / "IMG_0013 (1).PNG")
    (tmp_path / "notes.txt").write_text("60,00 mm\n")
    asked = dicflow("init", tmp_path, "--square", "14.5")
    options = ["--left", "IMG_*", "--right", "P*"]
    short = shlex.join(["dicflow", "init", str(tmp_path), "--square", "14.5 mm", *options])
    assert (asked.code, asked.err.splitlines()[2].strip()) == (2, short)
    answer = dicflow("init", tmp_path, "--square", "14.5", *options)
    assert answer.code == 0, answer.err
    assert "left out: 1 copy of a photograph, IMG_0013 (1).PNG" in answer.out
    assert "square: 14.5 mm\n" in (tmp_path / "pipeline.yaml").read_text()


def test_without_the_square_it_is_left_open(photographs, tmp_path):
    for part in ("photos", "boards"):
        shutil.copytree(photographs / part, tmp_path / part)
    answer = dicflow("init", tmp_path)
    assert "; fill in what is marked" in answer.out
    assert OPEN in (tmp_path / "pipeline.yaml").read_text()
    dicflow("run", tmp_path / "pipeline.yaml").refuses(2, "rig.square: ", "give side of one square of the board")


def test_one_camera_is_measured_in_pixels(photographs, tmp_path):
    for path in (photographs / "photos" / "left").iterdir():
        shutil.copy(path, tmp_path / path.name.replace("step_", "img"))
    answer = dicflow("init", tmp_path)
    assert answer.out.startswith(f"specimen: {STEPS} photographs of one camera, *.png\n")
    result = Pipeline.load(tmp_path / "pipeline.yaml").run(scheduler="sync")
    assert result.outcome.ok, result.outcome.errors
    total = result.product("total", -1)
    assert total.attrs["unit"] == "px"
    assert np.nanmean(total["eyy"]) > 0.3


def test_a_letter_is_not_a_camera_without_the_other_one(photographs, tmp_path):
    """As in names like ``Sample3-000 N2 C0 R0``; the reference comes first, wherever its name is sorted."""
    for step, name in enumerate(("Reference", "A000 C0 R0", "A001 C0 R0")):
        shutil.copy(photographs / "photos" / "left" / f"step_0{step}.png", tmp_path / f"{name}.png")
    answer = dicflow("init", tmp_path)
    assert answer.out.startswith("specimen: 3 photographs of one camera, Reference.png, A*.png\n")
    values = parse((tmp_path / "pipeline.yaml").read_text(), "p.yaml").data["stages"]["photos"]
    assert list(Images(**values).steps(tmp_path)) == ["Reference", "A000 C0 R0", "A001 C0 R0"]


def test_boards_alone_are_not_a_specimen(photographs, tmp_path):
    shutil.copytree(photographs / "boards" / "left", tmp_path / "left")
    dicflow("init", tmp_path).refuses(2, "no photographs of a specimen found, only those of a board (left: 8)")


def test_folders_without_photographs(photographs, tmp_path):
    dicflow("init", tmp_path / "none").refuses(2, "none: no such folder; name the folder that holds the photographs")
    dicflow("init", tmp_path).refuses(2, f"{tmp_path}: no photographs of a specimen found, expected .png")


def test_photographs_that_cannot_be_read_are_named(tmp_path):
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        (tmp_path / side / "a_1.png").write_bytes(b"\x89PNG\r\n\x1a\n and no more")
    dicflow("init", tmp_path).refuses(2, "no photograph can be read, such as left/a_1.png; copy them into it again")


@pytest.mark.parametrize("square", ["10 mm", None])
@pytest.mark.parametrize("name", ['a "b", c', "x: [1}", "#1 \\n é 😀"])
def test_names_with_signs_of_yaml_read_back(name, square):
    photos = Photographs([f"{name}/*.png"], [f"{name}/r*.png"], {})
    boards = Photographs([f"{name}*", "b"], [f"{name}?", "c"], {}, Way("order", ()))
    gauge = Gauge("x", "its longer side", ((1, 2), (30, 2)))
    found = Found(
        photos, boards, Board("checkerboard", (9, 6)), None, f"{name}.geojson", Caliper(f"{name}.csv", ""), gauge
    )
    stages = parse(pipeline_text(found, square, Path("p.yaml")), "p.yaml").data["stages"]
    assert stages["photos"]["left"] == photos.left[0]
    assert (stages["boards"]["right"], stages["boards"]["pair_by"]) == (boards.right, "order")
    assert (stages["region"]["file"], stages["compare"]["caliper"]) == (found.region, f"{name}.csv")
    assert stages["probes"]["extensometers"] == {"along_load": [[1, 2], [30, 2]]}
    assert stages["compare"]["axis"] == "x"


@pytest.mark.parametrize(
    ("board", "values"),
    [
        (Board("charuco", (8, 6), "5x5_50", 0.7), {"target": "charuco", "dictionary": "5x5_50", "marker": 0.7}),
        (Board("circles", (7, 5)), {"target": "circles"}),
        (Board("asymmetric_circles", (4, 11)), {"target": "asymmetric_circles"}),
    ],
)
def test_the_board_that_was_seen_is_written(board, values):
    series = Photographs(["l*.png"], ["r*.png"], {})
    stages = parse(pipeline_text(Found(series, series, board), None, Path("p.yaml")), "p.yaml").data["stages"]
    assert stages["corners"] == {"stage": "corners", "images": "boards", "size": list(board.size), **values}


def test_the_text_is_checked_also_where_the_square_is_left_open():
    series = Photographs(["*.png"], ["r.png"], {})
    with pytest.raises(ConfigurationError, match=r"corners\.size"):
        pipeline_text(Found(series, series, Board("checkerboard", (0, 6))), None, Path("p.yaml"))


def test_a_caliper_table_that_does_not_fit_is_named_and_not_compared(photographs, tmp_path):
    shutil.copytree(photographs / "photos" / "left", tmp_path / "left")
    (tmp_path / "caliper.csv").write_text("phase,load_g,length_mm\nloading,0,60\n")
    answer = dicflow("init", tmp_path)
    assert "caliper table: caliper.csv, not compared: 1 rows, but 3 steps; write one row per step" in answer.out
    stages = parse((tmp_path / "pipeline.yaml").read_text(), "p.yaml").data["stages"]
    assert "probes" in stages
    assert "compare" not in stages
