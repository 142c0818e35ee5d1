import json

import numpy as np
import pytest
from boards import SIZE, SQUARE_MM, board_corners, board_photograph, verged_rig
from pydantic import ValidationError

from dicflow.core.calibration.board import Board
from dicflow.core.cameras.camera import rotation_angle_deg
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.boards import BoardMarks
from dicflow.kinds.images import Images
from dicflow.kinds.rig import rig_from_json
from dicflow.stages.calibrate import Calibrate
from dicflow.stages.corners import Corners

pytestmark = pytest.mark.slow

RIG = verged_rig()
HOMOGRAPHY = np.array([[30.0, -4.0, 90.0], [5.0, 28.0, 70.0], [6e-3, 1e-2, 1.0]])
BLANK = np.full((300, 400), 120, np.uint8)


@pytest.fixture(scope="module")
def photograph():
    return board_photograph(HOMOGRAPHY, (300, 400))


def images(left, right=None):
    return Images.write(left, right)


def corners(left, right, size=SIZE, sizes=((640, 480), (640, 480)), shown=None):
    """The product of the stage for given corners; None stands for a photograph without the board."""
    sides = {"left": left, "right": right}
    marks = {side: np.empty((0, 2)) if xy is None else xy for side, xy in sides.items()}
    seen = {side: shown if xy is None else Board("checkerboard", size) for side, xy in sides.items()}
    reasons = {side: "no board found" if xy is None else "" for side, xy in sides.items()}
    return BoardMarks.write(marks, seen, Board("checkerboard", size), dict(zip(sides, sizes, strict=True)), reasons)


@pytest.fixture(scope="module")
def pairs():
    return [corners(left, right) for left, right in zip(*board_corners(RIG), strict=True)]


def stage(**values):
    return Calibrate(stage="calibrate", square=SQUARE_MM, **values)


def test_corners_of_both_photographs(photograph):
    product = Corners(stage="corners", size=SIZE).run(images=images(left=photograph, right=photograph[:, ::-1].copy()))
    assert product.kind == "corners"
    assert product["left"].shape == product["right"].shape == (54, 2)
    board = {"target": "checkerboard", "size": [9, 6], "dictionary": None, "marker": None}
    assert product.attrs == {
        "board": board,
        "image_sizes": {"left": [400, 300], "right": [400, 300]},
        "found": {"left": True, "right": True},
        "shown": {"left": board, "right": board},
        "reasons": {},
    }


def test_a_board_that_is_not_seen_is_no_error(photograph):
    product = Corners(stage="corners", size=(8, 5)).run(images=images(left=photograph, right=BLANK))
    assert product["left"].shape == product["right"].shape == (0, 2)
    assert product.attrs["found"] == {"left": False, "right": False}
    assert product.attrs["shown"]["left"]["size"] == [9, 6]
    assert product.attrs["shown"]["right"] is None
    shows = "shows a checkerboard of 9 × 6 inner corners"
    assert product.attrs["reasons"] == {"left": shows, "right": "no board found"}


def test_one_camera_has_one_set_of_corners(photograph):
    product = Corners(stage="corners", size=SIZE).run(images=images(left=photograph))
    assert set(product.variables) == {"left"}


def test_cameras_may_have_photographs_of_two_sizes(photograph):
    wider = np.pad(photograph, ((0, 0), (60, 20)), constant_values=210)
    product = Corners(stage="corners", size=SIZE).run(images=images(left=photograph, right=wider))
    assert BoardMarks.read(product).image_sizes == {"left": (400, 300), "right": (480, 300)}
    left, right = (np.sort(product[side], axis=0) for side in ("left", "right"))
    np.testing.assert_allclose(right, left + np.array([60.0, 0.0]), atol=0.01)


@pytest.mark.parametrize("size", [[9], [9, 6, 2], [2, 6], [9, -6], [9.5, 6]])
def test_a_size_is_two_numbers_of_corners(size):
    with pytest.raises(ValidationError):
        Corners(stage="corners", size=size)


def test_rig_from_corners(pairs):
    product = stage(tangential=True).run(corners=tuple(pairs))
    rig = rig_from_json(product.attrs["rig"])
    assert rotation_angle_deg(rig.rotation, RIG.rotation) < 1e-6
    np.testing.assert_allclose(rig.translation, RIG.translation, atol=1e-4)
    assert len(product.attrs["pairs"]) == 12
    assert all(pair["used"] and pair["left_px"] < 1e-5 for pair in product.attrs["pairs"])
    assert "0.000 px, 12 of 12 pairs" in product.attrs["verdict"]
    assert product.attrs["summary"]["baseline_mm"] == pytest.approx(np.linalg.norm(RIG.translation))
    assert product.attrs["parameters"][:2] == ["left fx", "left fy"]
    assert product.attrs["parameters"][-4:] == ["rz", "tx", "ty", "tz"]
    json.dumps(product.attrs, allow_nan=False)


def test_the_rig_says_how_certain_it_is(pairs):
    """σ of the figures is that of the product's covariance; the squares are measured with rigs from other pairs."""
    generator = np.random.default_rng(2)
    noisy = [
        corners(*(pair[side] + generator.normal(0.0, 0.05, (54, 2)) for side in ("left", "right"))) for pair in pairs
    ]
    product = stage(tangential=True, loss="huber").run(corners=noisy)
    covariance, summary = np.array(product.attrs["covariance"]), product.attrs["summary"]
    names = product.attrs["parameters"]
    assert covariance.shape == (len(names), len(names))
    assert summary["sigma_left_fx_px"] == pytest.approx(np.sqrt(covariance[0, 0]))
    assert summary["sigma_right_fy_px"] == pytest.approx(
        np.sqrt(covariance[names.index("right fy")][names.index("right fy")])
    )
    along = RIG.translation / np.linalg.norm(RIG.translation)
    assert summary["sigma_baseline_mm"] == pytest.approx(np.sqrt(along @ covariance[-3:, -3:] @ along), rel=0.01)
    assert abs(summary["baseline_mm"] - np.linalg.norm(RIG.translation)) < 3.5 * summary["sigma_baseline_mm"]
    assert summary["noise_px"] == pytest.approx(0.05, rel=0.1)
    assert summary["square_mm"] == pytest.approx(SQUARE_MM, abs=3.0 * summary["square_spread_mm"] / np.sqrt(12))
    assert summary["square_error_pct"] == pytest.approx(100.0 * (summary["square_mm"] / SQUARE_MM - 1.0))
    assert all(summary[f"spread_{name}"] > 0.0 for name in ("left_fx_px", "baseline_mm", "angle_deg"))


def test_a_pair_without_a_board_is_not_used(pairs):
    product = stage(tangential=True).run(corners=(pairs[0], corners(None, pairs[1]["right"]), *pairs[2:]))
    assert product.attrs["pairs"][1] == {"name": "pair 2", "used": False, "reason": "left: no board found"}
    assert "11 of 12 pairs" in product.attrs["verdict"]


@pytest.mark.parametrize("shown", [[0, 1, 2], [4, 13, 22, 31, 40, 49], [0, 1, 2, 3, 4, 5, 6, 7, 8, 22]])
def test_a_pair_with_few_corners_is_not_used(pairs, shown):
    """Three, a column, or a row and one more: they do not say where the board is."""
    few = np.where(np.isin(np.arange(54), shown)[:, None], pairs[4]["left"], np.nan)
    product = stage(tangential=True).run(corners=(*pairs[:4], corners(few, pairs[4]["right"]), *pairs[5:]))
    assert product.attrs["pairs"][4] == {"name": "pair 5", "used": False, "reason": "too few corners"}
    np.testing.assert_allclose(rig_from_json(product.attrs["rig"]).translation, RIG.translation, atol=1e-4)


def test_two_cameras_of_different_size(pairs):
    """A right camera whose sensor was read out in a window: its principal point moves, everything else stays."""
    sizes = ((640, 480), (600, 440))
    smaller = [corners(pair["left"], pair["right"] - [30.0, 20.0], sizes=sizes) for pair in pairs]
    rig = rig_from_json(stage(tangential=True).run(corners=smaller).attrs["rig"])
    assert (rig.left.size, rig.right.size) == sizes
    np.testing.assert_allclose(rig.right.matrix[:2, 2], RIG.right.matrix[:2, 2] - [30.0, 20.0], atol=1e-3)
    np.testing.assert_allclose(rig.translation, RIG.translation, atol=1e-4)


def test_an_offset_moves_the_principal_points(pairs):
    """The photographs of the specimen say how large the windows are."""
    specimen = images(np.zeros((360, 480), np.uint8), np.zeros((400, 500), np.uint8))
    whole = stage(tangential=True).run(corners=pairs)
    product = stage(tangential=True, offset={"left": [80, 60], "right": [30, 20]}).run(corners=pairs, images=specimen)
    rig, before = (rig_from_json(one.attrs["rig"]) for one in (product, whole))
    assert (rig.left.size, rig.right.size) == ((480, 360), (500, 400))
    np.testing.assert_allclose(rig.left.matrix[:2, 2], before.left.matrix[:2, 2] - [80.0, 60.0], rtol=1e-9)
    np.testing.assert_allclose(rig.right.matrix[:2, 2], before.right.matrix[:2, 2] - [30.0, 20.0], rtol=1e-9)
    np.testing.assert_allclose(rig.rotation, before.rotation, atol=1e-12)
    with pytest.raises(StageError, match="offset needs the photographs"):
        stage(offset={}).run(corners=pairs)


def test_the_square_is_a_length_with_a_unit(pairs):
    product = Calibrate(stage="calibrate", square="1 cm", tangential=True).run(corners=tuple(pairs))
    np.testing.assert_allclose(rig_from_json(product.attrs["rig"]).translation, RIG.translation, atol=1e-4)


@pytest.mark.parametrize("square", [0, -3.0, float("nan"), "14 px"])
def test_the_square_is_positive(square):
    with pytest.raises(ValidationError):
        Calibrate(stage="calibrate", square=square)


def test_a_board_seen_in_no_pair():
    none = tuple(corners(None, None) for _ in range(9))
    with pytest.raises(
        StageError, match=r"a checkerboard of 9 × 6 inner corners is seen in none of 9 pairs; show the whole board"
    ):
        stage().run(corners=none)


def test_a_wrong_board_size_names_the_size_that_is_seen():
    none = tuple(corners(None, None, size=(8, 5), shown=Board("checkerboard", (9, 6))) for _ in range(9))
    with pytest.raises(StageError, match=r"18 photographs show .* 9 × 6 .*: set size: \[9, 6\]$"):
        stage().run(corners=none)


def test_too_few_pairs(pairs):
    with pytest.raises(StageError, match=r"7 of 9 pairs.* 8 "):
        stage().run(corners=(*pairs[:7], corners(None, pairs[7]["right"]), corners(pairs[8]["left"], None)))


def test_pairs_of_two_sizes(pairs):
    odd = corners(pairs[3]["left"], pairs[3]["right"], sizes=((640, 480), (800, 600)))
    with pytest.raises(StageError, match=r"right one of pair 1 .* 640 × 480 .* pair 4 .* 800 × 600"):
        stage().run(corners=(*pairs[:3], odd, *pairs[4:]))


def test_one_camera_is_not_enough(pairs):
    left = Product("corners", {"left": pairs[0].variables["left"]}, pairs[0].attrs)
    with pytest.raises(StageError, match="photographs of two cameras"):
        stage().run(corners=(left,) * 9)


def noisy_pairs(pairs, shifts=()):
    """Pairs with noise of 0.03 px; pair, side, corner and shift [px] of single corners."""
    generator = np.random.default_rng(4)
    marks = [{side: pair[side] + generator.normal(0.0, 0.03, (54, 2)) for side in ("left", "right")} for pair in pairs]
    for number, side, corner, shift in shifts:
        marks[number][side][corner] += shift
    return marks


def test_a_corner_is_left_out_by_its_place(pairs):
    marks = noisy_pairs(pairs)
    place = marks[3]["right"][20].copy()
    said = {"pair 4": {"right": [(place + 2.0).tolist()]}}
    product = stage(leave_out=said).run(corners=[corners(**one) for one in marks])
    marks[3]["right"][20] = np.nan
    expected = stage().run(corners=[corners(**one) for one in marks])
    assert product.attrs["summary"] == pytest.approx(expected.attrs["summary"], rel=1e-7)
    assert product.attrs["pairs"][3].pop("left_out") == {"right": [place.round(3).tolist()]}
    for found, pair in zip(product.attrs["pairs"], expected.attrs["pairs"], strict=True):
        errors = ("left_px", "right_px", "epipolar_px")
        assert [found[name] for name in errors] == pytest.approx([pair[name] for name in errors], rel=1e-7)
    assert product.warnings == ()
    everything = stage().run(corners=[corners(**one) for one in noisy_pairs(pairs)]).attrs["summary"]
    assert everything["baseline_mm"] != pytest.approx(product.attrs["summary"]["baseline_mm"], rel=1e-7)


def test_a_corner_that_is_not_there_cannot_be_left_out(pairs):
    with pytest.raises(StageError, match="pair 40, which is no pair; pairs: pair 1, "):
        stage(leave_out={"pair 40": {"left": [[1, 2]]}}).run(corners=pairs)
    with pytest.raises(StageError, match=r"pair 2, left has no corner within 5 px of \[1.0, 2.0\]"):
        stage(leave_out={"pair 2": {"left": [[1, 2]]}}).run(corners=pairs)
    with pytest.raises(ValidationError):
        stage(leave_out={"pair 2": {"middle": [[1, 2]]}})


def test_gross_corners_are_left_out_and_named_until_the_file_says_so(pairs):
    shifts = [(2, "left", 7, (3.0, 0.0)), (8, "right", 50, (0.0, -20.0))]
    marks = noisy_pairs(pairs, shifts)
    boards = [corners(**one) for one in marks]
    product = stage().run(corners=boards)
    (x, y), (u, v) = marks[2]["left"][7], marks[8]["right"][50]
    (warning,) = product.warnings
    assert warning.startswith(
        f"2 corners far off all others are left out: pair 3, left, at ({x:.0f}, {y:.0f}) by 3.0 px; "
        f"pair 9, right, at ({u:.0f}, {v:.0f}) by 20.0 px"
    )
    (found,) = product.attrs["pairs"][8]["gross"]["right"]
    np.testing.assert_allclose(found, [u, v, 20.0], atol=0.2)
    assert all(pair["used"] for pair in product.attrs["pairs"])
    known = {"pair 3": {"left": [[x, y]]}, "pair 9": {"right": [[u, v]]}}
    silent = stage(leave_out=known).run(corners=boards)
    assert silent.warnings == ()
    np.testing.assert_allclose(silent.attrs["rig"]["translation_mm"], product.attrs["rig"]["translation_mm"], rtol=1e-6)
    json.dumps(product.attrs, allow_nan=False)
