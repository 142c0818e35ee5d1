import html
import json
import re

import numpy as np
import pytest

from dicflow.core.calibration.board import Board
from dicflow.core.cameras.camera import project, windowed
from dicflow.engine.product import Product
from dicflow.kinds.boards import BoardMarks
from dicflow.kinds.rig import CalibratedRig, rig_from_json
from dicflow.pipeline import Pipeline
from dicflow.report import calibration as module
from dicflow.report.calibration import calibration
from dicflow.report.drawing import Shape, drawing, ticks
from tests.pages import context_of


@pytest.fixture(scope="module")
def loaded(pipeline, measured):
    return Pipeline.load(pipeline)


@pytest.fixture(scope="module")
def section(loaded, tmp_path_factory):
    return calibration(context_of(loaded, tmp_path_factory.mktemp("report")))


def test_it_says_what_the_calibration_is_worth(loaded, section):
    attrs = loaded.result().product("rig").attrs
    assert attrs["verdict"][1:] in html.unescape(section.body)
    for pair in attrs["pairs"]:
        assert f'<th scope="row">{pair["name"]}</th>' in section.body
    assert section.body.count('class="bar left"') == sum("left_px" in pair for pair in attrs["pairs"])
    assert "off 14.5 mm" in section.body


def test_cameras_boards_coverage_and_common_rows_are_drawn(section):
    titles = re.findall(r'drawing" role="img" aria-label="([^"]*)"', section.body)
    assert titles == ["Corners, left camera", "Corners, right camera", "From above", "From the side"]
    assert section.body.count("data:image/jpeg;base64,") == 2
    assert "X [mm]" in section.body
    assert "x [px]" in section.body


def test_boards_stand_where_the_left_photographs_show_them(loaded):
    result = loaded.result()
    attrs = result.product("rig").attrs
    camera = rig_from_json(attrs["rig"]).left
    for pair in attrs["pairs"]:
        if not pair["used"]:
            continue
        corners = result.product("corners", pair["name"])
        columns, rows = corners.attrs["board"]["size"]
        outline = module._outline(module._board(BoardMarks.read(corners), 14.5), corners["left"], camera)
        board = corners["left"].reshape(rows, columns, 2)
        shown = np.stack([board[0, 0], board[0, -1], board[-1, -1], board[-1, 0]])
        apart = np.linalg.norm(project(camera, outline) - shown, axis=-1)
        assert apart.mean() < 4 * pair["left_px"] + 0.05
        assert np.linalg.norm(outline[1] - outline[0]) == pytest.approx(14.5 * (columns - 1))


def test_hidden_corners_leave_boards_in_their_places(loaded):
    """The corners that the left camera sees say where the board is; of those that are hidden, nothing is drawn."""
    result = loaded.result()
    calibrated = CalibratedRig.read(result.product("rig"))
    name = next(pair["name"] for pair in calibrated.pairs if pair["used"])
    whole = BoardMarks.read(result.product("corners", name))
    parts = {
        side: np.where(np.arange(54)[:, None] % 5 == k, whole[side], np.nan) for k, side in enumerate(("left", "right"))
    }
    hidden = BoardMarks.read(BoardMarks.write(parts, {}, whole.board, whole.image_sizes))
    drawn, expected = (module._drawn(calibrated, {name: board}, 14.5) for board in (hidden, whole))
    assert "nan" not in json.dumps(drawn).lower()
    assert len(re.findall("M", drawn[0].shapes[0][2])) == 11
    place, true = (np.array(re.findall(r"-?[\d.]+", one[2].shapes[0][2]), dtype=float) for one in (drawn, expected))
    np.testing.assert_allclose(place, true, atol=2.0)


def test_boards_of_windowed_cameras_stand_where_they_stood(loaded):
    """The corners count from the whole photograph, the camera from its window."""
    result = loaded.result()
    product = result.product("rig")
    calibrated = CalibratedRig.read(product)
    corners = {p["name"]: BoardMarks.read(result.product("corners", p["name"])) for p in calibrated.pairs if p["used"]}
    rig = calibrated.cameras
    small = rig._replace(left=windowed(rig.left, (30, 20), (300, 400)), right=windowed(rig.right, (10, 5), (300, 400)))
    windows = CalibratedRig.read(calibrated.with_windows(small, {"left": (30, 20), "right": (10, 5)}))
    _, _, above, _ = (one.shapes for one in module._drawn(windows, corners, 14.5))
    whole = module._outline(
        module._board(next(iter(corners.values())), 14.5), next(iter(corners.values()))["left"], rig.left
    )
    marks = next(iter(corners.values()))["left"] - windows.offset("left")
    board = module._board(next(iter(corners.values())), 14.5)
    np.testing.assert_allclose(module._outline(board, marks, small.left), whole, atol=1e-6)
    assert len(above) == len(corners) + 10


def test_nothing_is_drawn_twice(loaded, tmp_path, monkeypatch):
    first = calibration(context_of(loaded, tmp_path))
    monkeypatch.setattr(module, "_drawn", None)
    monkeypatch.setattr(module, "_pair", None)
    assert calibration(context_of(loaded, tmp_path)) == first


def test_pairs_that_take_no_part_are_marked():
    pairs = [
        {"name": "a", "used": True, "left_px": 0.1, "right_px": 0.2, "epipolar_px": None},
        {"name": "b", "used": False, "left_px": 0.4, "right_px": 0.3, "epipolar_px": 0.1},
        {"name": "c", "used": False, "reason": "left: no board found"},
    ]
    first, second, third = module._pairs(pairs)
    assert first["bars"] == [("left", pytest.approx(25.0)), ("right", pytest.approx(50.0))]
    assert (first["errors"], first["fate"]) == (["0.10", "0.20", "–"], "")
    assert second["fate"] == "dropped"
    assert (third["bars"], third["fate"]) == ([], "left: no board found")


def test_the_pyramid_of_a_camera_starts_at_its_centre(loaded):
    rig = rig_from_json(loaded.result().product("rig").attrs["rig"])
    faces = module._pyramid(rig.right, 50.0, rig.rotation, rig.translation)
    np.testing.assert_allclose(faces[1][0], -rig.rotation.T @ rig.translation, atol=1e-9)
    seen = rig.rotation @ faces[0].T + rig.translation[:, None]
    np.testing.assert_allclose(seen[2], 50.0)


def rig_of(**attrs):
    return CalibratedRig.read(Product("rig", attrs=attrs))


def test_a_rig_from_a_file_has_cameras_and_its_warnings(loaded, section):
    attrs = dict(loaded.result().product("rig").attrs) | {"pairs": [], "warnings": ["it has no size"]}
    assert [one.title for one in module._drawn(rig_of(**attrs), {}, 1.0)] == ["From above", "From the side"]
    read = rig_of(**attrs | {"verdict": "read from a file"})
    assert module._warnings(read) == ("Calibration: it has no size.",)
    found = {"baseline_mm": 100.0, "angle_deg": 14.25}
    assert [name for name, *_ in module._facts(rig_of(summary=found, pairs=[]), found, None)] == ["Baseline", "Angle"]
    assert section.warnings == module._warnings(CalibratedRig.read(loaded.result().product("rig")))


def test_a_poor_calibration_is_warned_of():
    assert module._warnings(rig_of(verdict="poor: 2.10 px")) == ("The calibration is poor: 2.10 px.",)
    assert module._warnings(rig_of(verdict="usable: 0.3 px")) == ("The calibration is usable: 0.3 px.",)
    assert module._warnings(rig_of(verdict="good: 0.02 px")) == ()


def test_circles_are_drawn_as_their_grid():
    def marks(target, size):
        return BoardMarks.read(BoardMarks.write({}, {}, Board(target, size), {}))

    assert len(module._board(marks("asymmetric_circles", (4, 11)), 10.0)) == 44
    assert module._board(marks("checkerboard", (9, 6)), 2.0).max() == pytest.approx(16.0)


def test_shapes_are_drawn_to_scale_and_upwards():
    square = Shape("board", "a", np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 5.0], [0.0, 5.0]]))
    made = drawing("", ("x [mm]", "y [mm]"), (0, 0, 10, 5), [square], upwards=True)
    x, y, width, height = made.frame
    assert (width, height) == (300.0, 150.0)
    corners = [tuple(map(float, pair.split())) for pair in re.findall(r"[\d.]+ [\d.]+", made.shapes[0][2])]
    assert corners == [(x, y + height), (x + width, y + height), (x + width, y), (x, y)]
    assert json.dumps(made)


@pytest.mark.parametrize(
    ("low", "high", "least", "texts"),
    [
        (0, 720, 3, ["0", "200", "400", "600"]),
        (-0.12, 0.21, 3, ["−0.1", "0.0", "0.1", "0.2"]),
        (-60, 60, 1, ["−50", "0", "50"]),
    ],
)
def test_ticks_are_round(low, high, least, texts):
    assert [text for _, text in ticks(low, high, least)] == texts


def test_a_refined_rig_is_shown_beside_the_calibration(copied, tmp_path):
    """With the verdict of both, pairs and boards of the calibration, and the figures of the rig that is used."""
    text = copied.read_text().replace("  region:", "  refined: {stage: refine, images: photos}\n  region:")
    copied.write_text(text)
    loaded = Pipeline.load(copied)
    assert loaded.run(scheduler="sync", workers=1).outcome.ok
    rig, refined = (CalibratedRig.read(loaded.result().product(stage)) for stage in ("rig", "refined"))
    body = html.unescape(calibration(context_of(loaded, tmp_path)).body)
    assert rig.verdict[1:] in body
    assert refined.verdict[1:] in body
    assert body.count('class="bar left"') == sum("left_px" in pair for pair in rig.pairs)
    assert "Points off their epipolar lines" in body
    assert loaded.result().source("pair", "rig") == "refined"
