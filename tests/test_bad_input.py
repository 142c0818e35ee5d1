"""Bad input: one message that names the place and the remedy, no traceback, and a store that stays whole."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pydantic import BaseModel, ValidationError
from small import STEPS, dicflow

from dicflow.pipeline.registry import node_class, stage_names

ROOT_USER = hasattr(os, "getuid") and os.getuid() == 0
NEEDED = {
    "images": {"left": "x"},
    "corners": {"size": (9, 6)},
    "calibrate": {"square": 1},
    "channels": {"file": "x"},
    "compare": {"caliper": "x"},
    "rig_file": {"file": "x"},
    "probes": {"points": {"a": (1, 1)}},
    "scale": {"length": 1, "ends": ((1, 1), (1, 9))},
    "curve": {"file": "x", "mode": "uniaxial"},
    "stress": {"width": 20, "thickness": 0.2, "u_thickness": 0.005},
    "sheet": {"thickness": 0.2, "u_thickness": 0.005},
}
AFTER = {"computed": 0, "failed": 0, "skipped": 0}


@pytest.fixture
def data(pipeline, tmp_path):
    """The experiment's folder, to be spoilt."""
    folder = tmp_path / "data"
    shutil.copytree(pipeline.parent, folder, ignore=shutil.ignore_patterns(".dicflow", "results"))
    return folder


@pytest.fixture
def run(data, measured, tmp_path):
    """Runs the pipeline in a folder; afterwards the store must be whole and no half file about."""

    computed = False
    own = shutil.copytree(measured, tmp_path / "measured", copy_function=os.link)  # nothing is changed in its place

    def command(*arguments, store=own):
        nonlocal computed
        given = (data / "quickstart.yaml", "--store", store, "--output", tmp_path / "o")
        answer = dicflow("run", *given, "--scheduler", "sync", "--workers", 1, "--json", *arguments)
        computed |= answer.code != 2
        return answer

    yield command
    if computed:
        assert dicflow("verify", own).code == 0
    assert not list((own / "tmp").iterdir())
    assert not list(tmp_path.rglob("*.part"))


def change(folder, old, new):
    """Another pipeline file."""
    path = folder / "quickstart.yaml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def repaint(path, paint):
    """Another photograph, made of the one that was there."""
    with Image.open(path) as image:
        grey = np.array(image)
    Image.fromarray(paint(grey)).save(path)


# photographs


def test_an_empty_folder(run, data):
    for path in (data / "photos" / "left").iterdir():
        path.unlink()
    run().refuses(
        2, "quickstart.yaml:6:3: photos: left: no photograph matches 'photos/left/*.png' in", "check the pattern"
    )


def test_a_folder_where_a_pattern_should_be(run, data):
    change(data, '"photos/left/*.png"', "photos/left")
    run().refuses(2, "photos: left: 'photos/left' is a folder")


@pytest.mark.parametrize("side", ["left", "right"])
def test_one_cameras_image_missing(run, data, side):
    other = {"left": "right", "right": "left"}[side]
    (data / "photos" / side / "step_01.png").unlink()
    run().refuses(2, "photos: ", f"without a partner: {other} step_01.png")


def test_images_of_two_sizes(run, data):
    repaint(data / "photos" / "right" / "step_02.png", lambda grey: grey[:-2])
    run().refuses(2, "photos/right/step_02.png: 432 × 574 px", "step_00.png has 432 × 576 px", "must have one size")


def test_images_of_two_depths(run, data):
    repaint(data / "photos" / "left" / "step_01.png", lambda grey: grey.astype(np.uint16) * 256)
    run().refuses(2, "photos/left/step_01.png: 432 × 576 px at 16 bit", "must have one size and depth")


def test_a_truncated_jpeg(run, data):
    for path in (data / "photos").rglob("*.png"):
        with Image.open(path) as image:
            image.save(path.with_suffix(".jpg"))
    change(data, "left/*.png", "left/*.jpg")
    change(data, "right/*.png", "right/*.jpg")
    victim = data / "photos" / "right" / "step_01.jpg"
    victim.write_bytes(victim.read_bytes()[:3000])
    run().refuses(2, "right/step_01.jpg: the photograph is truncated or damaged; copy it again from the camera")
    victim.write_bytes(b"")
    run().refuses(2, "right/step_01.jpg: the photograph is empty")
    victim.write_bytes(b"no photograph at all")
    run().refuses(2, "right/step_01.jpg: ", "PNG, TIFF, JPEG or BMP")


def test_numbers_instead_of_grey_levels(run, data):
    grey = np.zeros((576, 432), np.float32)
    Image.fromarray(grey).save(data / "photos" / "left" / "step_01.tif")
    (data / "photos" / "left" / "step_01.png").unlink()
    change(data, '"photos/left/*.png"', '["photos/left/*.png", "photos/left/*.tif"]')
    run().refuses(2, "step_01.tif: holds numbers with fractions; save it as PNG or TIFF with 8 or 16 bits")


def test_a_step_with_no_texture(run, data):
    repaint(data / "photos" / "left" / "step_01.png", lambda grey: np.full_like(grey, 90))
    answer = run()
    assert answer.code == 0
    assert any("track/step_01: no texture in this left photograph" in warning for warning in answer.line["warnings"])
    assert "track/step_01: no texture in this left photograph" in answer.err
    assert answer.line["stages"]["maps"]["computed"] == 1


def test_black_photographs_of_one_camera(run, data):
    for path in (data / "photos" / "right").iterdir():
        repaint(path, np.zeros_like)
    run().refuses(1, "disparity/step_0", "no range of disparities was found", "give the range as [least, largest]")


# boards


def test_a_board_seen_in_no_pair(run, data):
    for path in (data / "boards").rglob("*.png"):
        repaint(path, lambda grey: np.full_like(grey, 90))
    run().refuses(
        1, "rig: a checkerboard of 9 × 6 inner corners is seen in none of 8 pairs; show the whole board to both cameras"
    )


def test_too_few_boards(run, data):
    for path in sorted((data / "boards").rglob("board_0[567].png")):
        path.unlink()
    run().refuses(1, "rig: ", "is seen by both cameras in 5 of 5 pairs, and 8 are needed; take 3 more")


def test_wrong_board_size(run, data):
    for path in sorted((data / "boards").rglob("board_0[2-7].png")):
        path.unlink()
    change(data, "size: [9, 6]", "size: [9, 5]")
    run().refuses(1, "rig: a checkerboard of 9 × 5 inner corners is seen in none of 2 pairs", "set size: [9, 6]")


def test_boards_of_another_camera(run, data):
    for path in (data / "boards").rglob("*.png"):
        repaint(path, lambda grey: np.pad(grey, 8, mode="edge"))
    run().refuses(1, "pair/step_0", "448 × 592 px", "432 × 576", "photograph the board with the settings used for")


# regions and tables


@pytest.mark.parametrize(
    ("region", "code", "words"),
    [
        ("rectangle: [100, 100, 900, 200]", 1, "region: the region spans x 100 … 900"),
        ("rectangle: [100, 100, 90, 200]", 2, "region.rectangle: a rectangle is [x0, y0, x1, y1] with x0 < x1"),
        ("rectangle: [5, 5, 25, 25]", 1, "region: the region shows too little texture"),
        ("polygons: [[[1, 2], [3, 4]]]", 2, "region.polygons.0: list should have at least 3 items"),
        ("polygons: [[[.nan, 2], [3, 4], [9, 9]]]", 2, "must be a finite number, found nan"),
        ("file: nothing.geojson", 2, "nothing.geojson: cannot be read (no such file or directory)"),
        ("file: caliper.csv", 2, "caliper.csv: text, not a photograph in PNG, TIFF, JPEG or BMP"),
        ("file: region.geojson, rectangle: [1, 2, 3, 4]", 2, "give exactly one of rectangle, polygons, file and auto"),
    ],
)
def test_a_region_that_cannot_be_used(run, data, region, code, words):
    change(data, "file: region.geojson", region)
    run().refuses(code, words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "region.geojson:1:1: expected a region in GeoJSON, but it is not valid JSON"),
        ("[]", "region.geojson: expected polygons in GeoJSON, found list"),
        ('{"type": "Point", "coordinates": [1, 2]}', "found Point"),
        ('{"type": "Polygon", "coordinates": [[[1, 2], [3, 4], [1, 2]]]}', "at least three points"),
        ('{"type": "FeatureCollection", "features": []}', "no polygon; draw the region's outline"),
    ],
)
def test_a_region_file_without_a_region(run, data, text, words):
    (data / "region.geojson").write_text(text)
    answer = run()
    answer.refuses(answer.code, words)
    assert answer.code in (1, 2)


@pytest.mark.parametrize(
    ("spoil", "code", "words"),
    [
        (lambda rows: rows[:-1], 2, f"has {STEPS - 1} rows, but there are {STEPS} steps"),
        (lambda rows: rows + rows[-1:], 2, f"has {STEPS + 1} rows, but there are {STEPS} steps"),
        (
            lambda rows: [],
            2,
            "caliper.csv: has no rows, expected a caliper table; write a line of names, load_g, length_mm, phase",
        ),
        (lambda rows: [row.replace("length_mm", "length") for row in rows], 2, "no column 'length_mm' among phase"),
        (lambda rows: [row.replace("loading,0.00", "loading,nan") for row in rows], 2, "load_g is 'nan', expected"),
        (lambda rows: [*rows[:-1], "resting,1,2"], 2, "the phase is 'resting'; write loading or unloading"),
        (lambda rows: [*rows[:-1], "loading,1"], 2, "has 2 values for 3 columns"),
    ],
)
def test_a_caliper_table_that_does_not_fit(run, data, spoil, code, words):
    path = data / "caliper.csv"
    path.write_text("\n".join(spoil(path.read_text().splitlines())) + "\n")
    run().refuses(code, "caliper.csv", words)


# the pipeline file


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("  photos:", "\tphotos:", "quickstart.yaml:6:1: not valid YAML"),
        ("square: 14.5 mm", "square: .nan", "quickstart.yaml:11:27: rig.square: must be a finite number, found nan"),
        ("square: 14.5 mm", "square: -14.5 mm", "rig.square: must be greater than 0, found -14.5"),
        ("square: 14.5 mm", "square: 14.5 px", "rig.square: '14.5 px'"),
        ("square: 14.5 mm", "square: .inf", "rig.square: must be a finite number, found inf"),
        ("subsets: [3, 3]", "subsets: [3, -3]", "track.subsets.1: must be greater than or equal to 1, found -3"),
        ("subsets: [3, 3]", "step_size: 0", "track.step_size: must be greater than or equal to 1, found 0"),
        ("stage: surface,", "stage: surfaces,", "quickstart.yaml:24:13: surface: no stage 'surfaces', did you mean"),
        ("detector: KAZE", "detectr: KAZE", "features.detectr: unknown parameter, did you mean 'detector'?"),
        ("detector: KAZE", "detector: SURF", "must be 'KAZE', 'AKAZE', 'BRISK', 'ORB' or 'SIFT', found 'SURF'"),
        ("cloud: filled", "cloud: fild", "surface.cloud: no stage 'fild', did you mean 'filled'?"),
        ("cloud: filled", "cloud: surface", "name one of cloud, filled"),
        ("{stage: fill, cloud: cloud}", "{stage: fill, cloud: surface}", "wait for each other; change one input"),
        ("  cloud: {stage", "  surface: {stage", "key 'surface' "),
        ("stages:", "stage:", "unknown key 'stage', did you mean 'stages'?"),
        ("dicflow: 1", "dicflow: 2", "format 1, the file says 2"),
        ("{stage: maps", "!!python/object/apply:os.system {stage: maps", "the tag"),
        ("title:", "sweep: {grid: {strain.window: 3}}\ntitle:", "sweep: 'grid' does not map each parameter to a list"),
        ("title:", "sweep: {grid: {strain.degree: [1, x]}}\ntitle:", "quickstart.yaml:4:16: strain.degree: "),
        ("quantities: [eyy]", "quantities: [ezz]", "maps.quantities.0: must be 'U', 'V', 'W', 'exx'"),
        ("quantities: [eyy]", "colour_map: rainbows", "maps.colour_map: must be 'viridis'"),
    ],
)  # fmt: skip
def test_a_wrong_pipeline_file(run, data, old, new, words):
    change(data, old, new)
    run().refuses(2, words)


def _spoilt(value):
    """A parameter's value with one of its numbers negative, or not a number."""
    if isinstance(value, bool):
        return
    if isinstance(value, int | float):
        yield from (-7, math.nan, math.inf)
    elif isinstance(value, tuple):
        for place, inner in enumerate(value):
            yield from ([*value[:place], bad, *value[place + 1 :]] for bad in _spoilt(inner))
    elif isinstance(value, BaseModel):
        whole = value.model_dump()
        for name in whole:
            yield from ({**whole, name: bad} for bad in _spoilt(getattr(value, name)))


@pytest.mark.parametrize("name", stage_names())
def test_no_stage_takes_a_number_that_is_negative_or_nan(name):
    kind, given = node_class(name), NEEDED.get(name, {})
    node = kind(**given)
    for field in kind.model_fields:
        for bad in _spoilt(getattr(node, field)):
            with pytest.raises(ValidationError):
                kind(**{**given, field: bad})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "'stages:' at the top, found an empty file"),
        ("- stages", "found a list"),
        ("42", "found a single value"),
        ("stages: 3", "'stages:' must map names to stages"),
        ("stages: {a: 3}", "a: expected a mapping; say which stage it is, with 'stage: …'"),
        ("stages: {a: &x {stage: images, left: *x}}", "an alias refers to a value that contains it"),
    ],
)
def test_yaml_that_is_not_a_pipeline(run, data, text, words):
    (data / "quickstart.yaml").write_text(text)
    run().refuses(2, "quickstart.yaml:1:", words)


def test_bytes_that_are_not_text(run, data):
    (data / "quickstart.yaml").write_bytes(b"\xff\xfe\x00")
    run().refuses(2, "quickstart.yaml: is damaged UTF-16 text; save it as plain text in UTF-8")


def test_all_problems_are_listed_at_once(run, data):
    change(data, "square: 14.5 mm", "square: 0")
    change(data, "detector: KAZE", "detectr: KAZE")
    answer = run()
    answer.refuses(2, "rig.square")
    answer.refuses(2, "features.detectr")
    *problems, help_ = answer.err.splitlines()
    assert (len(problems), help_) == (2, "help: dicflow help pipeline-file")


# places


@pytest.mark.parametrize("way", ["absolute", "upwards", "link"])
def test_a_path_outside_of_the_allowed_folders(run, data, tmp_path, way):
    secret = tmp_path / "elsewhere" / "caliper.csv"
    secret.parent.mkdir()
    shutil.move(data / "caliper.csv", secret)
    given = {"absolute": str(secret), "upwards": "../elsewhere/caliper.csv", "link": "link.csv"}[way]
    (data / "link.csv").symlink_to(secret)
    change(data, "caliper.csv", given)
    run().refuses(2, "comparison: ", "lies outside the folder of quickstart.yaml", "given with --data")


def test_a_file_that_is_missing(run, data):
    (data / "caliper.csv").unlink()
    run().refuses(2, "caliper.csv: cannot be read (no such file or directory); check the path")


def test_an_output_folder_that_cannot_be_written(run, data, tmp_path):
    (tmp_path / "file").write_text("")
    answer = run("--output", tmp_path / "file" / "maps", "--set", "strain.window=[33, 33]")
    answer.refuses(2, "file/maps: cannot be written (a file stands where a folder should be); name another")
    assert answer.out == ""


def test_output_that_cannot_be_written_by_other_commands(pipeline, measured, tmp_path):
    (tmp_path / "file").write_text("")
    place = tmp_path / "file" / "x.svg"
    dicflow("graph", pipeline, "--output", place).refuses(2, "x.svg: cannot be written (a file stands where")
    dicflow("export", pipeline, "total", "--output", place).refuses(2, "x.svg: cannot be written")


# stores


def test_a_store_of_a_newer_format(run, tmp_path):
    store = tmp_path / "newer"
    store.mkdir()
    mark = store / "dicflow.json"
    mark.write_text(json.dumps({"format": 99}))
    run(store=store).refuses(2, "newer: has format 99, this release reads 2; use the dicflow that wrote it")
    for command in ("gc", "verify", "pin"):
        dicflow(command, store).refuses(2, "has format 99")
    assert [path.name for path in store.iterdir()] == ["dicflow.json"]
    mark.write_text("scribble")
    run(store=store).refuses(2, "dicflow.json: is not JSON", "name another folder, or write")


def test_a_folder_that_is_not_a_store(run, data, tmp_path):
    run(store=data).refuses(2, "data: holds other files and is not a store; name an empty or new folder")
    (tmp_path / "file").write_text("")
    run(store=tmp_path / "file").refuses(2, "file: cannot be written", "name another store")


def _mounted(place, options):
    """Whether a disk could be mounted; that needs root, and not every container lets it."""
    return ROOT_USER and subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", place]).returncode == 0


@pytest.fixture
def disk(tmp_path):
    """A small disk."""
    place = tmp_path / "disk"
    place.mkdir()
    if not _mounted(place, "size=400k"):
        pytest.skip("mounting a disk is not permitted here")
    yield place
    subprocess.run(["umount", place], check=True)


def test_a_full_disk(run, disk):
    answer = run(store=disk / "store")
    answer.refuses(1, "the disk is full; free some space", "nothing that was stored is lost")
    assert dicflow("verify", disk / "store").out == "nothing is damaged\n"


def test_a_full_disk_for_the_pictures(run, disk):
    with suppress(OSError):
        (disk / "filler").write_bytes(bytes(400_000))
    run("--output", disk / "o").refuses(2, "cannot be written (no space left on device)")
    assert not [path for path in disk.rglob("*.part")]


def test_a_read_only_store(run, pipeline, disk, tmp_path):
    """It serves what it holds, and says what to do about the rest."""
    alone = pipeline.parent / "alone.yaml"
    alone.write_text('stages: {boards: {stage: images, left: "boards/left/*.png", keep: never}}')
    given = (alone, "--store", disk / "store", "--output", tmp_path / "o", "--scheduler", "sync")
    assert dicflow("run", *given).code == 0
    subprocess.run(["mount", "-o", "remount,ro", disk], check=True)
    assert dicflow("run", *given, "--json").line["counts"] == {**AFTER, "hit": 8}
    assert dicflow("ls", *given[:3]).code == 0
    run(store=disk / "store").refuses(2, "disk/store: cannot be written (read-only", "name another store")
    run(store=disk / "other").refuses(2, "disk/other: cannot be written (read-only", "name another store")
    run("--output", disk / "o").refuses(2, "disk/o: cannot be written (read-only file system)")
    assert dicflow("verify", disk / "store").code == 0
    alone.unlink()


def test_a_store_that_may_not_be_written(run, tmp_path):
    if ROOT_USER:
        pytest.skip("root may write everywhere")
    place = Path(tmp_path / "locked")
    place.mkdir(mode=0o555)
    run(store=place / "store").refuses(2, "cannot be written (permission denied); get write access")
