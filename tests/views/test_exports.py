"""Whole tests and single products as files: complete, exact, and never in place of others unasked."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from dicflow.core.cameras.camera import Camera, Rig, camera_matrix, project, undistort
from dicflow.core.photographs.region import contains, densify, rectangle
from dicflow.core.status import Status
from dicflow.engine.product import Product
from dicflow.errors import ConfigurationError, DicflowError
from dicflow.io.exports import csv as csv_module
from dicflow.io.region import read_geojson
from dicflow.io.rig import read_rig
from dicflow.kinds.region import polygons_from_json, polygons_to_json
from dicflow.kinds.rig import rig_to_json
from dicflow.pipeline import Pipeline
from dicflow.stages.region import Region
from dicflow.views import exports
from dicflow.views.exported_pictures import Drawn, write_surfaces
from dicflow.views.exports import Selection, format_names
from dicflow.views.exports import export as write
from dicflow.views.workbooks import megabytes
from tests.io.exported_totals import total
from tests.small import STEPS, dicflow


def export(result, output, to="csv", force=False, name="test", note=lambda text: None, **chosen):
    return write(result, output, Selection(**chosen), to=to, force=force, name=name, note=note)


PAIRS = [f"step_{number:02d}" for number in range(1, STEPS)]
BESIDE = {"comparison.csv", "region.geojson", "rig.json"}


@pytest.fixture
def result(pipeline, measured):
    return Pipeline.load(pipeline).result()


def names(paths):
    return {path.name for path in paths}


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("form", ["csv", "matchid", "challenge", "npz", "mat"])
def test_a_whole_test_as_one_file_per_step(form, result, tmp_path):
    suffix = form if form in ("npz", "mat") else "csv"
    expected = {f"total_{step}.{suffix}" for step in PAIRS} | BESIDE
    assert names(export(result, tmp_path, to=form)) == expected == set(contents(tmp_path))


def test_a_whole_test_in_one_file(result, tmp_path):
    assert names(export(result, tmp_path, to="hdf5", name="strip")) == {"strip.h5"} | BESIDE


def test_a_whole_test_for_paraview(result, tmp_path):
    expected = {f"total_{step}.vtu" for step in PAIRS} | {"total.pvd"} | BESIDE
    assert names(export(result, tmp_path, to="vtu")) == expected


@pytest.mark.parametrize("step", PAIRS)
def test_the_time_of_a_step_is_its_number_in_the_test(result, tmp_path, step):
    """The reference, step_00, has 0; also where other steps are left out."""
    export(result, tmp_path, stage="total", step=step, to="vtu")
    (entry,) = ElementTree.parse(tmp_path / "total.pvd").getroot().findall("Collection/DataSet")
    assert entry.get("timestep") == str(int(step.removeprefix("step_")))


def test_pictures_of_a_whole_test_are_those_of_its_maps(result, tmp_path):
    assert names(export(result, tmp_path, to="png")) == {f"total_{step}_eyy.png" for step in PAIRS}


@pytest.mark.parametrize("form", ["pdf", "svg"])
def test_a_picture_for_print(form, result, tmp_path):
    for folder in ("a", "b"):
        export(result, tmp_path / folder, stage="total", step="step_01", quantities=["exx"], to=form)
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    content = contents(tmp_path / "a")[f"total_step_01_exx.{form}"]
    assert content.startswith(b"%PDF" if form == "pdf" else b"<?xml")


def test_a_movie_of_one_step_is_remarked(result, tmp_path):
    notes = []
    export(result, tmp_path, stage="total", step=PAIRS[0], quantities=["exx"], to="gif", note=notes.append)
    (note,) = notes
    assert note.startswith("total: ")
    assert "png" in note


def test_tables_that_no_spreadsheet_opens_are_noted(result, tmp_path, monkeypatch):
    height, width = result.arrays("photos", 0)["left"].shape
    notes = []
    monkeypatch.setattr(exports, "_MOST_ROWS", height * width)
    export(result, tmp_path, stage="photos", step="step_00", note=notes.append)
    assert notes == []
    monkeypatch.setattr(exports, "_MOST_ROWS", height * width - 1)
    export(result, tmp_path, stage="photos", step="step_00", note=notes.append, force=True)
    (path,) = tmp_path.iterdir()
    rows = sum(not line.startswith("#") for line in path.read_text().splitlines()) - 1
    assert rows == height * width
    assert f"photos: a table of {rows:,} rows" in notes[0]


def test_a_movie_shows_each_step(result, tmp_path):
    (path,) = export(result, tmp_path, stage="total", quantities=["exx"], to="gif")
    assert path.name == "total_exx.gif"
    with Image.open(path) as movie:
        assert movie.n_frames == len(PAIRS)


@pytest.mark.parametrize("form", ["mp4", "webm"])
def test_a_movie_for_browsers(form, result, tmp_path):
    import cv2

    (path,) = export(result, tmp_path, stage="total", quantities=["eyy"], to=form)
    movie = cv2.VideoCapture(str(path))
    assert movie.get(cv2.CAP_PROP_FRAME_COUNT) == len(PAIRS)
    movie.release()


def test_places_in_the_photograph_are_those_of_the_material(result, tmp_path):
    """The points were laid in the rectified image, on a region that was drawn in the photograph."""
    (path,) = export(result, tmp_path, stage="total", step="step_01", to="challenge")
    table = np.genfromtxt(path, delimiter=",", names=True)
    (region,) = export(result, tmp_path, stage="region", to="geojson")
    inside = contains(read_geojson(region).polygons, np.stack([table["x_image"], table["y_image"]], axis=-1))
    assert len(table) > 100
    assert inside.mean() > 0.99
    left = read_rig(*export(result, tmp_path, stage="rig", to="json")).left
    total = result.product("total", "step_01")
    again = project(left, np.stack([table[axis] for axis in "XYZ"], axis=-1))
    assert total.attrs["unit"] == "mm"
    assert np.abs(again - np.stack([table["x_image"], table["y_image"]], axis=-1)).max() < 1.0


def test_a_region_comes_back(result, tmp_path):
    (path,) = export(result, tmp_path, stage="region", to="geojson")
    product = result.product("region")
    tracked = result.product(result.source("region", "images"), 0)
    again = Region(file=str(path)).run(tracked, rig=result.product("rig"), file_path=path)
    kept, back = (polygons_from_json(part.attrs["polygons"]) for part in (product, again))
    assert [len(polygon.holes) for polygon in kept] == [len(polygon.holes) for polygon in back]
    for one, other in zip(kept, back, strict=True):
        apart = np.linalg.norm(one.exterior[:, None] - other.exterior[None], axis=-1)
        assert apart.min(axis=1).max() < 0.01
    assert again.attrs["area_px"] == pytest.approx(product.attrs["area_px"], rel=1e-4)


class OneCamera:
    """A result whose region lies in the undistorted photograph."""

    left = Camera(camera_matrix(800.0, (320, 240)), np.array([-0.2, 0.05, 1e-3, -1e-3, 0.0]), (640, 480))
    rig = Product("rig", attrs={"rig": rig_to_json(Rig(left, left, np.eye(3), np.array([-50.0, 0.0, 0.0])))})
    region = Product("region", attrs={"polygons": polygons_to_json([rectangle(100.0, 80.0, 500.0, 400.0)])})

    stages = ("rig", "plane", "region")

    def steps(self, stage):
        return ()

    def kind(self, stage):
        return stage

    def stages_of(self, kind):
        return [kind]

    def source(self, stage, port, variant):
        return {"images": "plane", "rig": "rig"}[port]

    def product(self, stage, step, variant):
        return {"rig": self.rig, "region": self.region}[stage]


def test_a_region_of_an_undistorted_photograph_is_that_of_the_photograph(tmp_path):
    (path,) = export(OneCamera(), tmp_path, stage="region", to="geojson")
    (polygon,) = read_geojson(path).polygons
    matrix = OneCamera.left.matrix
    straight = undistort(OneCamera.left, polygon.exterior) @ matrix[:2, :2].T + matrix[:2, 2]
    assert np.abs(polygon.exterior - straight).max() > 1.0
    (kept,) = polygons_from_json(OneCamera.region.attrs["polygons"])
    np.testing.assert_allclose(straight, densify(kept.exterior, 20.0), atol=1e-9)


def test_a_rig_comes_back(result, tmp_path):
    (path,) = export(result, tmp_path, stage="rig", to="json")
    assert rig_to_json(read_rig(path)) == result.product("rig").attrs["rig"]


def test_a_whole_test_as_one_workbook(result, tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    notes = []
    assert names(export(result, tmp_path, to="xlsx", note=notes.append)) == {"test.xlsx", "region.geojson", "rig.json"}
    book = openpyxl.load_workbook(tmp_path / "test.xlsx", read_only=True)
    assert book.sheetnames == ["summary", f"total_{PAIRS[-1]}", "comparison"]
    assert notes[0].startswith(f"total: the points of {PAIRS[-1]} alone, of {len(PAIRS)} steps; ")
    header, *rows = book[f"total_{PAIRS[-1]}"].iter_rows(values_only=True)
    column = [row[header.index("eyy")] for row in rows]
    total = result.product("total", PAIRS[-1])
    expected = total["eyy"][total["status"] != Status.OUTSIDE]
    np.testing.assert_allclose([np.nan if cell is None else cell for cell in column], expected, rtol=5e-6)
    summary = list(book["summary"].iter_rows(values_only=True))
    assert [row[1] for row in summary[1:]] == PAIRS
    comparison = list(book["comparison"].iter_rows(values_only=True))
    assert len(comparison) == 1 + len(result.product("comparison").attrs["rows"])


def test_a_workbook_of_another_step_and_of_all(result, tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    export(result, tmp_path / "one", to="xlsx", step=PAIRS[0])
    one = openpyxl.load_workbook(tmp_path / "one" / "test.xlsx", read_only=True)
    assert one.sheetnames == ["summary", f"total_{PAIRS[0]}", "comparison"]
    assert len(list(one["summary"].rows)) == 1 + len(PAIRS)
    notes = []
    export(result, tmp_path / "all", stage="total", to="xlsx", note=notes.append)
    every = openpyxl.load_workbook(tmp_path / "all" / "total.xlsx", read_only=True)
    assert every.sheetnames == ["summary", *(f"total_{step}" for step in PAIRS)]
    assert notes == []


def test_a_large_workbook_is_named_before_it_is_written(result, tmp_path, monkeypatch):
    pytest.importorskip("openpyxl")
    monkeypatch.setattr(exports, "_LARGE_MB", 0.01)
    notes = []
    (path,) = export(result, tmp_path, stage="total", to="xlsx", note=notes.append)
    stated = megabytes(result, "total", PAIRS, 0)
    assert notes == [f"total: about {stated:.0f} MB for the points of {len(PAIRS)} steps; --step writes those of one"]
    assert 0.1 < path.stat().st_size / 1e6 / stated < 1.5  # totals of tracking have fewer columns


def test_digits_and_decimal_commas_of_the_command_line(pipeline, measured, result, tmp_path):
    answer = dicflow("export", pipeline, "total", "--output", tmp_path, "--locale", "de", "--digits", 4)
    assert answer.code == 0, answer.err
    text = (tmp_path / f"total_{PAIRS[-1]}.csv").read_text(encoding="utf-8")
    lines = [line.split(";") for line in text.splitlines() if not line.startswith("#")]
    column = [float(line[lines[0].index("eyy")].replace(",", ".")) for line in lines[1:]]
    np.testing.assert_allclose(column, result.product("total", PAIRS[-1])["eyy"].ravel(), rtol=5e-4)
    dicflow("export", pipeline, "--locale", "fr").refuses(2, "--locale", "fr")


def test_nothing_is_overwritten_unasked(result, tmp_path):
    first = export(result, tmp_path, to="csv")
    before = contents(tmp_path)
    first[-1].write_text("mine")
    kept = contents(tmp_path)
    with pytest.raises(ConfigurationError, match="exists; add --force to overwrite"):
        export(result, tmp_path, to="csv")
    assert contents(tmp_path) == kept
    assert export(result, tmp_path, to="csv", force=True) == first
    assert contents(tmp_path) == before


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError(28, "No space left on device")])
def test_an_export_that_breaks_off_leaves_nothing(error, result, tmp_path, monkeypatch):
    written = csv_module.csv_text

    def failing(product, name, style):
        if name.endswith(PAIRS[-1]):
            raise error
        return written(product, name, style)

    (tmp_path / f"total_{PAIRS[0]}.csv").write_text("mine")
    before = contents(tmp_path)
    monkeypatch.setattr(csv_module, "csv_text", failing)
    with pytest.raises((KeyboardInterrupt, DicflowError)):
        export(result, tmp_path, to="csv", force=True)
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"to": "hdf"}, "no format 'hdf', did you mean 'hdf5'?; there are challenge, csv"),
        ({"stage": "totl"}, "no stage 'totl', did you mean 'total'?"),
        ({"stage": "total", "step": "step_9"}, "total has no step 'step_9'; it has step_01, step_02"),
        (
            {"stage": "total", "quantities": ["eyyy"]},
            "no quantity 'eyyy' in total, did you mean 'eyy'?; it has U, V, W",
        ),
        ({"quantities": ["eyz"], "to": "png"}, "no quantity 'eyz' in total"),
        ({"quantities": ["eyz"], "to": "gif"}, "no quantity 'eyz' in total"),
        ({"stage": "rig", "quantities": ["eyy"]}, "no quantity 'eyy' in rig; it has no array"),
        ({"stage": "rig", "to": "vtu"}, "rig: a product of kind rig is no total, which vtu is for"),
        ({"stage": "rig", "to": "gif"}, "rig: a product of kind rig is no total, which gif is for"),
        ({"stage": "total", "to": "json"}, "total: a product of kind total is no rig"),
        ({"stage": "total", "quantities": ["xyz"], "to": "png"}, "xyz has no array to draw"),
        ({"stage": "total", "quantities": ["status"], "to": "gif"}, "no movie of status"),
    ],
)
def test_unknown_names_list_the_known_ones(asked, message, result, tmp_path):
    with pytest.raises(ConfigurationError) as refused:
        export(result, tmp_path / "new", **asked)
    assert message in str(refused.value)
    assert list(tmp_path.iterdir()) == []


def test_what_is_not_in_the_store_is_left_out_and_noted(result, tmp_path, monkeypatch):
    has = type(result).has
    lost = {"comparison", ("total", PAIRS[0])}
    monkeypatch.setattr(
        type(result),
        "has",
        lambda self, stage, step=None, variant=0: (
            stage not in lost and (stage, step) not in lost and has(self, stage, step, variant)
        ),
    )
    notes = []
    written = names(export(result, tmp_path, note=notes.append))
    assert written == {f"total_{PAIRS[1]}.csv", "region.geojson", "rig.json"}
    assert notes == [
        f"total: 1 of {len(PAIRS)} steps are not in the store and were left out: {PAIRS[0]}",
        "comparison is not in the store and was left out",
    ]


def test_the_command_names_every_format():
    listed = " ".join(dicflow("export", "--help").out.split())
    for name in format_names():
        assert name in listed


def test_the_command_for_a_whole_test(pipeline, measured, tmp_path):
    answer = dicflow("export", pipeline, "--format", "hdf5", "--output", tmp_path)
    assert answer.code == 0
    assert {line.rpartition("/")[2] for line in answer.out.splitlines()} == {"quickstart.h5"} | BESIDE
    dicflow("export", pipeline, "--format", "hdf5", "--output", tmp_path).refuses(2, "exists; add --force")


def test_named_arrays_are_all_drawn_or_none(result, tmp_path):
    with pytest.raises(ConfigurationError, match="xyz has no array to draw"):
        export(result, tmp_path, stage="total", quantities=["eyy", "xyz"], to="png")
    assert not list(tmp_path.iterdir())


def test_a_surface_in_space(result, tmp_path):
    pytest.importorskip("pyvista")
    paths = export(result, tmp_path, stage="total", step=PAIRS[0], quantities=["eyy"], to="surface")
    assert names(paths) == {f"total_{PAIRS[0]}_eyy_surface.png"}
    with Image.open(paths[0]) as image:
        image.verify()


def test_a_surface_without_pyvista_leaves_no_file(result, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(ConfigurationError, match=r"pip install 'dicflow\[solid\]'"):
        export(result, tmp_path, to="surface")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("form", ["planar", "precise"])
def test_one_camera_shows_no_surface_in_space(form, tmp_path, monkeypatch):
    """What two cameras measure goes on to ask for pyvista."""
    result = SimpleNamespace(product=lambda stage, step, variant: total(form), stages_of=lambda kind: [])
    monkeypatch.setitem(sys.modules, "pyvista", None)
    cause = "one camera" if form == "planar" else "needs pyvista"
    with pytest.raises(ConfigurationError, match=cause):
        write_surfaces(Drawn(result, {"total": ["step_01"]}, ("eyy",), 0), "surface", tmp_path, whole=False)


def test_only_totals_have_a_surface(result, tmp_path):
    with pytest.raises(ConfigurationError, match="kind features is no total, which surface is for"):
        export(result, tmp_path, stage="features", to="surface")


def test_the_words_for_the_formats_load_no_numerics():
    code = "import sys; from dicflow.cli.hand_over import _format_words; print(_format_words(), 'numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("False\n")
