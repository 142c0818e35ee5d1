"""One camera in millimetres: the same strains, lengths in proportion to the scale, with its uncertainty."""

import numpy as np
import pytest
from looking import ran
from measured_points import SHAPE, correlation, first_points, grid_px, sheet

from dicflow.core.calibration.board import Board
from dicflow.core.calibration.targets import board_points
from dicflow.core.cameras.camera import Camera, Rig, camera_matrix, project
from dicflow.errors import StageError
from dicflow.kinds.boards import BoardMarks
from dicflow.kinds.images import Images
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.scale import Scale as ScaleProduct
from dicflow.kinds.total import Total
from dicflow.stages.deformation import Deformation
from dicflow.stages.probes import Probes
from dicflow.stages.scale import Scale

PHOTOGRAPH = Images.write(np.zeros((800, 1000), np.float32))
GRADIENT = np.array([[0.8, 0.1], [0.0, 1.5]])
KNOWN = {"length": 40.0, "ends": ((100.0, 100.0), (100.0, 500.0)), "u_length": 0.2, "u_end": 0.0}
ENDS = ((380.0, 205.0), (380.0, 425.0))
RIG = Rig(
    Camera(camera_matrix(5000.0, (500, 400)), np.array([-0.2, 0.1, 0.0, 0.0, 0.0]), (1000, 800)),
    Camera(camera_matrix(5000.0, (500, 400)), np.zeros(5), (1000, 800)),
    np.eye(3),
    np.array([-100.0, 0.0, 0.0]),
)


def totals(scale=None):
    """Two steps: at rest, and deformed."""
    first = correlation(grid_px(), np.eye(2))
    steps = [first, correlation(grid_px() @ GRADIENT.T, GRADIENT)]
    return [Deformation().run(points=step, points_first=first, scale=scale) for step in steps]


def board(shift=0.0):
    """Marks of a board square to the camera at 500 mm, through a lens with distortion."""
    points = board_points((9, 6), 8.0)
    seen = project(RIG.left, points - points.mean(axis=0) + [0.0, 0.0, 500.0 + shift])
    target = Board("checkerboard", (9, 6))
    return BoardMarks.write({"left": seen}, {"left": target}, target, {"left": (1000, 800)})


def rig():
    return CalibratedRig.write(RIG, "given", {})


def test_lengths_are_in_millimetres_and_strains_unchanged():
    scale = Scale(**KNOWN, stand_off="500 mm").run(images=PHOTOGRAPH)
    plain, scaled = (Total.read(steps[1]) for steps in (totals(), totals(scale)))
    assert (plain.unit, scaled.unit) == ("px", "mm")
    assert not scaled.in_space
    for name in ("exx", "eyy", "gxy", "u_exx", "sigma_eyy"):
        np.testing.assert_allclose(scaled[name], plain[name], rtol=1e-5, atol=1e-10)
    for name in ("U", "V", "sigma_U", "u_V"):
        np.testing.assert_allclose(scaled[name], 0.1 * plain[name], rtol=1e-5)
    np.testing.assert_allclose(scaled["xyz"], 0.1 * plain["xyz"], rtol=1e-12)
    assert scaled.gauge.side_mm == pytest.approx(0.1 * scaled.gauge.side_px, rel=1e-6)


def test_the_scale_is_a_share_of_lengths_and_none_of_strains():
    scale = Scale(**KNOWN).run(images=PHOTOGRAPH)
    total = Total.read(totals(scale)[1])
    np.testing.assert_allclose(total["calibration_U"], 0.005 * np.abs(total["U"]), rtol=1e-5)
    np.testing.assert_allclose(total["calibration_xyz"], 0.005 * np.abs(total["xyz"]), rtol=1e-5)
    assert not np.nan_to_num(total["calibration_eyy"]).any()
    assert "calibration_U" not in totals()[1]


def test_a_rig_says_nothing_of_places_in_pixels():
    """One camera's photographs may lack their distortion by a rig; the shares of its uncertainty are for space."""
    known = CalibratedRig.write(RIG, "given", {}, covariance=1e-8 * np.eye(24))
    first = correlation(grid_px(), np.eye(2))
    total = Deformation().run(points=first, points_first=first, rig=known)
    assert not [name for name in total.variables if name.startswith("calibration")]


def test_probes_have_the_share_of_the_scale():
    scale = Scale(**KNOWN).run(images=PHOTOGRAPH)
    probes = ran(Probes(extensometers={"E": ENDS}, points={"P": (350.0, 300.0)}), total=totals(scale))
    length, elongation = probes["length"][0, -1], probes["elongation"][0, -1]
    assert length == pytest.approx(0.1 * np.linalg.norm(GRADIENT @ [0.0, 220.0]))
    assert probes["calibration_length"][0, -1] == pytest.approx(0.005 * length)
    assert probes["calibration_elongation"][0, -1] == pytest.approx(0.005 * elongation)
    assert probes["calibration_strain"][0, -1] == 0.0
    assert probes["calibration_V"][0, -1] == pytest.approx(0.005 * abs(probes["V"][0, -1]))
    assert probes["calibration_eyy"][0, -1] == 0.0
    assert probes.attrs["unit"] == "mm"


def test_a_board_seen_through_a_lens_and_the_stand_off_by_the_rig():
    plane = Images.write(np.zeros((800, 1000), np.float32), kind="plane")
    scale = ScaleProduct.read(Scale(square="8 mm", u_square="0.008 mm").run(images=plane, corners=[board()], rig=rig()))
    assert scale.mm_per_px == pytest.approx(0.1, rel=1e-6)
    assert scale.relative_u == pytest.approx(0.001, rel=0.01)
    assert scale.stand_off_mm == pytest.approx(500.0, rel=1e-6)
    assert "500 mm" in scale.product.warnings[0]
    assert "−0.2 %" in scale.product.warnings[0]


def test_a_motion_towards_the_camera_reads_as_the_strain_that_is_warned_of():
    """A sheet that moves 5 mm away from 500 mm shrinks by 5 / 505."""
    away = 5.0
    camera = Camera(RIG.left.matrix, np.zeros(5), RIG.left.size)
    before, after = (project(camera, sheet() + np.array([0.0, 0.0, dz])) for dz in (0.0, away))
    first = correlation(before, np.eye(2))
    total = Deformation().run(points=correlation(after, 500.0 / 505.0 * np.eye(2)), points_first=first)
    strain = total["eyy"][SHAPE[0] // 2, SHAPE[1] // 2]
    assert strain == pytest.approx(-away / (500.0 + away), rel=1e-6)
    assert strain == pytest.approx(-away / 500.0, rel=0.02)


def test_without_a_stand_off_the_warning_asks_for_it():
    product = Scale(**KNOWN).run(images=PHOTOGRAPH)
    assert "give stand_off" in product.warnings[0]
    assert ScaleProduct.read(product).stand_off_mm is None


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "either length and ends, or the square"),
        ({"length": 40.0}, "both length and ends"),
        ({**KNOWN, "square": 8.0}, "either length and ends, or the square"),
        ({**KNOWN, "ends": ((1.0, 1.0), (1.0, 1.0))}, "one place"),
    ],
)
def test_one_source_is_given(given, message):
    with pytest.raises(ValueError, match=message):
        Scale(**given)


def test_what_cannot_be_scaled_is_said():
    with pytest.raises(StageError, match=r"\[100, 900\], lies outside the 1000 × 800 px"):
        Scale(length=10, ends=((100, 100), (100, 900))).run(images=PHOTOGRAPH)
    with pytest.raises(StageError, match="add a stage 'corners'"):
        Scale(square=8).run(images=PHOTOGRAPH)
    target = Board("checkerboard", (9, 6))
    unseen = BoardMarks.write({"left": np.empty((0, 2))}, {"left": None}, target, {"left": (1000, 800)})
    with pytest.raises(StageError, match="found in no photograph"):
        Scale(square=8).run(images=PHOTOGRAPH, corners=[unseen])
    scale = Scale(**KNOWN).run(images=PHOTOGRAPH)
    points = first_points(sheet())
    with pytest.raises(StageError, match="two measured these points"):
        Deformation().run(points=points, points_first=points, scale=scale)
