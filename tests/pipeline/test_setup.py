"""The first pipeline file for a folder: pairs, boards and their size are found, and what is written runs."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from small import BOARDS, STEPS, dicflow

from dicflow.errors import ConfigurationError
from dicflow.io.configuration import parse
from dicflow.pipeline import Pipeline
from dicflow.start.first_file import OPEN, Found, Series, pipeline_text


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
    assert said[1] == f"boards: {BOARDS} pairs, boards/left/*.png and boards/right/*.png, 9 × 6 inner corners"
    assert said[2].startswith("disparity of the first pair: -")
    assert said[3] == f"wrote {folder}/pipeline.yaml; read it, then: dicflow run {folder}/pipeline.yaml"


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
    rows = result.product("compare").attrs["rows"]
    assert rows[-1]["dic_strain"] == pytest.approx(rows[-1]["caliper_strain"], rel=0.02)


def test_an_existing_file_is_kept(stereo):
    folder, _ = stereo
    before = (folder / "pipeline.yaml").read_bytes()
    dicflow("init", folder).refuses(2, "pipeline.yaml exists; add --force to overwrite it")
    dicflow("init", folder, "--square", "3 px", "--force").refuses(2, "pipeline.yaml:11:5: rig.square: '3 px'")
    assert (folder / "pipeline.yaml").read_bytes() == before


def test_without_the_square_it_is_left_open(photographs, tmp_path):
    for part in ("photos", "boards"):
        shutil.copytree(photographs / part, tmp_path / part)
    answer = dicflow("init", tmp_path)
    assert "; fill in the side of a square, then: dicflow run" in answer.out
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


@pytest.mark.parametrize(
    ("left", "right", "patterns"),
    [
        ("s{}_0.png", "s{}_1.png", ("*_0.png", "*_1.png")),
        ("ImageLeft{}.png", "ImageRight{}.png", ("*Left*.png", "*Right*.png")),
        ("cam0/{}.png", "cam1/{}.png", ("cam0/*.png", "cam1/*.png")),
        ("test/L/{}.png", "test/R/{}.png", ("test/L/*.png", "test/R/*.png")),
    ],
)
def test_cameras_distinguished_by_names(photographs, tmp_path, left, right, patterns):
    for step in range(2):
        for side, name in (("left", left), ("right", right)):
            place = tmp_path / name.format(step)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(photographs / "photos" / side / f"step_0{step}.png", place)
    assert dicflow("init", tmp_path).out.startswith(f"specimen: 2 pairs, {patterns[0]} and {patterns[1]}\n")


def test_a_letter_is_not_a_camera_without_the_other_one(photographs, tmp_path):
    """As in names like ``Sample3-000 N2 C0 R0``."""
    for step, name in enumerate(("Reference", "A000 C0 R0", "A001 C0 R0")):
        shutil.copy(photographs / "photos" / "left" / f"step_0{step}.png", tmp_path / f"{name}.png")
    assert dicflow("init", tmp_path).out.startswith("specimen: 3 photographs of one camera, *.png\n")


def test_boards_alone_are_not_a_specimen(photographs, tmp_path):
    shutil.copytree(photographs / "boards" / "left", tmp_path / "left")
    dicflow("init", tmp_path).refuses(2, "no photographs of a specimen found, only those of a board (8 photographs")


def test_folders_without_photographs(photographs, tmp_path):
    dicflow("init", tmp_path / "none").refuses(2, "none: no such folder; name the folder that holds the photographs")
    dicflow("init", tmp_path).refuses(2, f"{tmp_path}: no photographs of a specimen found, expected .png")
    for side in ("left", "right"):
        shutil.copytree(photographs / "photos" / side, tmp_path / side)
    (tmp_path / "right" / "step_01.png").unlink()
    dicflow("init", tmp_path).refuses(2, "left/*.png: 3 left and 2 right", "without a partner: left step_01.png")
    Image.new("L", (4, 4)).save(tmp_path / "right" / "step_01.png")
    (tmp_path / "left" / "step_01.png").write_bytes(b"")
    dicflow("init", tmp_path).refuses(2, "step_01.png: ")


def test_boards_are_distinguished_from_speckles_in_the_samples(stereo):
    """Speckles look like a small board here and there; most photographs must show one of the same size."""
    from small import ROOT

    from dicflow.start.first_file import _board_size, _series

    sizes = {one.left: _board_size(one) for one in _series(ROOT / "data_samples")}
    assert sizes == {"photos/left/*.png": None, "boards/left/*.png": (9, 6)}


@pytest.mark.parametrize("square", ["10 mm", None])
@pytest.mark.parametrize("name", ['a "b", c', "x: [1}", "#1 \\n é 😀"])
def test_names_with_signs_of_yaml_read_back(name, square):
    photos, boards = Series(f"{name}/*.png", f"{name}/r*.png", {}), Series(f"{name}*", f"{name}?", {})
    found = Found(photos, boards, (9, 6), None, f"{name}.geojson", f"caliper {name}.csv")
    stages = parse(pipeline_text(found, square, Path("p.yaml")), "p.yaml").data["stages"]
    assert (stages["photos"]["left"], stages["boards"]["right"]) == (photos.left, boards.right)
    assert (stages["region"]["file"], stages["compare"]["caliper"]) == (found.region, found.caliper)


def test_the_text_is_checked_also_where_the_square_is_left_open():
    series = Series("*.png", "r.png", {})
    with pytest.raises(ConfigurationError, match=r"corners\.size"):
        pipeline_text(Found(series, series, (0, 6), None, None, None), None, Path("p.yaml"))
