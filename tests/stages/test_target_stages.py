"""Every kind of calibration target, from rendered photographs to the rig they were rendered with."""

import numpy as np
import pytest
from boards import verged_rig
from pydantic import ValidationError

from dicflow.core.cameras.camera import rotation_angle_deg, rotation_matrix
from dicflow.core.cameras.rig_parameters import KEY_FIGURES, PARAMETERS, key_figures
from dicflow.core.synthetic.charuco import CharucoBoard, charuco_darkness, charuco_extent
from dicflow.core.synthetic.checkerboard import Checkerboard
from dicflow.core.synthetic.circles import CircleGrid, circle_darkness, circle_extent
from dicflow.core.synthetic.deformation import Deformation
from dicflow.core.synthetic.render import GreyLevels, add_noise_and_round, photograph
from dicflow.core.synthetic.stand import in_right_frame
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.kinds.images import Images
from dicflow.kinds.rig import rig_from_json
from dicflow.stages.calibrate import Calibrate
from dicflow.stages.corners import Corners

pytestmark = pytest.mark.slow

RIG = verged_rig()
PAIRS = 9
LOOK = GreyLevels(paper=205.0, ink=34.0)
GRID = CircleGrid(7, 5, 13.0, 4.0, margin=10.0, edge=0.4)
SHIFTED = CircleGrid(4, 9, 8.0, 3.6, asymmetric=True, margin=9.0, edge=0.4)
MARKED = CharucoBoard(Checkerboard(9, 7, 14.0, 4.0, 0.4), 0.7, "5x5_50")


def photographs(extent, pattern, place_mm):
    """Pairs of a target in places and tilts of all kinds, as products of stage images."""
    generator = np.random.default_rng(11)
    middle = np.array([extent.left + extent.right, extent.top + extent.bottom, 0.0]) / 2.0
    for k in range(PAIRS):
        turn = rotation_matrix(generator.uniform([-0.5, -0.5, -0.3], [0.5, 0.5, 0.3]))
        place = generator.uniform([-place_mm, -place_mm, 440.0], [place_mm, place_mm, 480.0])
        pose = Deformation(1.0, 1.0, rotation=turn, translation=place - turn @ middle)
        sides = {"left": (RIG.left, pose), "right": (RIG.right, in_right_frame(RIG, pose))}
        shown = {
            side: add_noise_and_round(photograph(camera, seen, extent, pattern, LOOK, 2), 1.5, [k, side == "right"])
            for side, (camera, seen) in sides.items()
        }
        yield Images.write(**shown)


def calibrated(corners, square):
    return Calibrate(stage="calibrate", square=square, tangential=True).run(corners=corners)


def assert_is_the_rig(product, noise_px):
    """Within 3.5 σ of the product's own covariance, and with the corners' noise as it is."""
    rig, summary = rig_from_json(product.attrs["rig"]), product.attrs["summary"]
    sigma = np.sqrt(np.diagonal(product.attrs["covariance"]))
    assert summary["noise_px"] < noise_px
    np.testing.assert_array_less(np.abs(rig.translation - RIG.translation), 3.5 * sigma[-3:])
    assert rotation_angle_deg(rig.rotation, RIG.rotation) < 3.5 * np.degrees(np.linalg.norm(sigma[-6:-3]))
    predicted = np.array([summary[f"sigma_{name}"] for name in KEY_FIGURES])
    np.testing.assert_array_less(np.abs(key_figures(rig) - key_figures(RIG)), 3.5 * predicted)


@pytest.fixture(scope="module")
def marked():
    """Corners of a ChArUco board that leaves the frame in most of the photographs."""
    stage = Corners(size=(8, 6), target="charuco", dictionary="5x5_50", marker=0.7)
    shown = photographs(charuco_extent(MARKED), lambda points: charuco_darkness(MARKED, points), 35.0)
    return [stage.run(images=images) for images in shown]


@pytest.mark.parametrize(
    ("grid", "target"), [(GRID, "circles"), (SHIFTED, "asymmetric_circles")], ids=["symmetric", "asymmetric"]
)
def test_circles_give_the_rig(grid, target):
    stage = Corners(size=(grid.columns, grid.rows), target=target)
    shown = photographs(circle_extent(grid), lambda points: circle_darkness(grid, points), 8.0)
    corners = [stage.run(images=images) for images in shown]
    assert all(product.attrs["found"] == {"left": True, "right": True} for product in corners)
    product = calibrated(corners, grid.spacing)
    assert_is_the_rig(product, 0.007)
    assert product.attrs["summary"]["square_error_pct"] == pytest.approx(0.0, abs=0.02)


def test_parts_of_a_marked_board_give_the_rig(marked):
    missing = [np.isnan(product[side]).any() for product in marked for side in ("left", "right")]
    assert sum(missing) > PAIRS
    product = calibrated(marked, 14.0)
    assert_is_the_rig(product, 0.007)
    assert product.attrs["summary"]["square_error_pct"] == pytest.approx(0.0, abs=0.02)
    assert np.shape(product.attrs["covariance"]) == (len(PARAMETERS), len(PARAMETERS))


def test_parts_that_only_one_camera_sees_count_too(marked):
    """Left and right photograph show no common corner in one pair: no epipolar distance, but the rig rests on it."""
    first = marked[0]
    columns = np.arange(48) % 8
    parts = {"left": columns < 4, "right": columns >= 4}
    halved = {
        side: Variable(("corner", "component"), np.where(kept[:, None], first[side], np.nan))
        for side, kept in parts.items()
    }
    product = calibrated([Product("corners", halved, first.attrs), *marked[1:]], 14.0)
    assert product.attrs["pairs"][0]["used"]
    assert product.attrs["pairs"][0]["epipolar_px"] is None
    assert_is_the_rig(product, 0.007)


def test_a_square_of_another_size_shows_in_no_figure_but_lengths(marked):
    """The known distance is checked against the side that was given; focal lengths do not depend on it."""
    exact, twice = (calibrated(marked, side) for side in (14.0, 28.0))
    ratio = {name: twice.attrs["summary"][name] / exact.attrs["summary"][name]
             for name in ("baseline_mm", "sigma_baseline_mm", "square_mm", "left_fx_px")}  # fmt: skip
    assert ratio == pytest.approx(
        {"baseline_mm": 2.0, "sigma_baseline_mm": 2.0, "square_mm": 2.0, "left_fx_px": 1.0}, rel=1e-4
    )


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"target": "charuco"}, "dictionary .* marker"),
        ({"target": "charuco", "dictionary": "4x4_50"}, "dictionary .* marker"),
        ({"target": "circles", "marker": 0.7}, "marker belongs to ChArUco boards"),
        ({"dictionary": "4x4_50"}, "dictionary belongs to ChArUco boards"),
        ({"target": "charuco", "dictionary": "4x4_55", "marker": 0.7}, "Input should be '4x4_50'"),
        ({"target": "charuco", "dictionary": "4x4_50", "marker": 1.2}, "less than 1"),
        ({"target": "charuco", "dictionary": "4x4_50", "marker": 0.7, "size": (11, 8)},
         "has 54 markers, more than the 50 of dictionary 4x4_50"),
        ({"target": "charuco", "dictionary": "apriltag_16h5", "marker": 0.7, "size": (7, 7)},
         "has 32 markers, more than the 30"),
    ],
)  # fmt: skip
def test_a_target_needs_what_belongs_to_it(values, message):
    with pytest.raises(ValidationError, match=message):
        Corners(**{"size": (7, 5), **values})


@pytest.mark.parametrize(
    ("target", "extra", "message"),
    [
        ("charuco", {"dictionary": "5x5_50", "marker": 0.5}, "ChArUco.* 7 × 5 .* dictionary"),
        ("circles", {}, "a grid of 7 × 5 circles is seen in none of 3 pairs; check its size"),
        ("asymmetric_circles", {}, "an asymmetric grid of 7 × 5 circles is seen in none of 3 pairs"),
    ],
)
def test_a_target_that_is_not_seen_is_named(target, extra, message):
    blank = np.full((300, 400), 120, np.uint8)
    stage = Corners(size=(7, 5), target=target, **extra)
    corners = [stage.run(images=Images.write(blank, blank))] * 3
    with pytest.raises(StageError, match=message):
        Calibrate(square=10.0).run(corners=corners)
