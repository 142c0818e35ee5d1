import cv2
import numpy as np
import pytest
from boards import verged_rig
from pydantic import ValidationError
from scenes import photographs_of_plane

from dicflow.core.cameras.camera import Camera, Rig, distort
from dicflow.core.cameras.rectification import raw_to_rectified, rectification
from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import rectangle
from dicflow.core.status import Status
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.kinds.images import Images
from dicflow.kinds.region import polygons_to_json
from dicflow.kinds.rig import CalibratedRig
from dicflow.stages.disparity import Disparity
from dicflow.stages.reconstruct import Reconstruct
from dicflow.stages.rectify import Rectify
from dicflow.stages.undistort import Undistort

pytestmark = pytest.mark.slow

RIG = verged_rig()
NORMAL = np.array([0.1, -0.15, 1.0]) / np.linalg.norm([0.1, -0.15, 1.0])
DISTANCE_MM = 395.0
RECTIFY, UNDISTORT = Rectify(stage="rectify"), Undistort(stage="undistort")


def images(left, right=None):
    return Images.write(left, right)


def rig_product(rig=RIG):
    return CalibratedRig.write(rig, "", {})


def track(*polygons):
    return Product("track", {}, {"polygons": polygons_to_json(polygons)})


def disparity(**values):
    return Disparity(stage="disparity", **values)


@pytest.fixture(scope="module")
def pair():
    return RECTIFY.run(images=images(*photographs_of_plane(RIG, NORMAL, DISTANCE_MM)), rig=rig_product())


@pytest.fixture(scope="module")
def region():
    hole = rectangle(330, 230, 380, 280).exterior
    return track(Polygon(rectangle(220, 150, 460, 360).exterior, (hole,)))


@pytest.fixture(scope="module")
def matched(pair, region):
    return disparity().run(pair=pair, rig=rig_product(), track=region)


def off_plane_mm(xyz):
    return xyz @ NORMAL - DISTANCE_MM


def test_rectified_pair_has_the_rig_s_view(pair):
    view = rectification(RIG)
    assert pair.kind == "rectified"
    assert pair["left"].shape == pair["right"].shape == view.size[::-1]
    assert pair["left"].dtype == np.uint8


def test_photographs_of_another_size_than_the_boards():
    small = np.zeros((240, 320), np.uint8)
    with pytest.raises(StageError, match=r"left camera .* 640 × 480 px.* 320 × 240"):
        RECTIFY.run(images=images(small, small), rig=rig_product())
    with pytest.raises(StageError, match=r"left camera .* 640 × 480 px.* 320 × 240"):
        UNDISTORT.run(images=images(small), rig=rig_product())


def test_one_photograph_cannot_be_rectified():
    with pytest.raises(StageError, match="add 'right' to the images"):
        RECTIFY.run(images=images(np.zeros((480, 640), np.uint8)), rig=rig_product())


def test_disparity_and_cloud_of_a_plane(matched, region):
    assert matched["disparity"].dtype == np.float32
    assert matched.attrs["summary"]["valid_share"] > 0.999
    cloud = Reconstruct(stage="reconstruct").run(disparity=matched, rig=rig_product(), track=region)
    assert cloud["xyz"].dtype == np.float32
    assert cloud.attrs["origin"] == matched.attrs["origin"]
    assert cloud.attrs["summary"]["background_share"] == 0.0
    error = off_plane_mm(cloud["xyz"].astype(float))[cloud["status"] == Status.VALID]
    assert np.abs(error.mean()) < 0.005
    assert error.std() < 0.02


def test_cost_follows_the_region(matched, pair):
    assert matched["disparity"].shape == (259, 289)
    assert matched.attrs["origin"] == [196, 126]
    assert matched["disparity"].size < 0.25 * pair["left"].size


def test_points_outside_the_region_and_in_its_holes_have_no_value(matched, region):
    cloud = Reconstruct(stage="reconstruct").run(disparity=matched, rig=rig_product(), track=region)
    x0, y0 = cloud.attrs["origin"]
    status = cloud["status"]
    assert (status[: 150 - y0] == Status.OUTSIDE).all()
    assert (status[235 - y0 : 275 - y0, 335 - x0 : 375 - x0] == Status.OUTSIDE).all()
    assert status[200 - y0, 300 - x0] == Status.VALID
    np.testing.assert_array_equal(np.isfinite(cloud["xyz"]).all(axis=-1), status == Status.VALID)


def test_points_behind_the_cameras_mean_swapped_photographs(matched, region):
    """The offset of the two principal points is far from −1000 px, so all depths change their sign."""
    turned = Variable(("row", "col"), matched["disparity"] - 1000.0)
    seen = Product("disparity", matched.variables | {"disparity": turned}, matched.attrs)
    with pytest.raises(StageError, match=r"0% of the points .* exchange left and right"):
        Reconstruct(stage="reconstruct").run(disparity=seen, rig=rig_product(), track=region)


def test_background_over_the_edge_is_kept_out(matched, region):
    changed = matched["disparity"].copy()
    changed[40:60, 30:34] -= 12.0
    seen = Product("disparity", matched.variables | {"disparity": Variable(("row", "col"), changed)}, matched.attrs)
    for gate, kept in (("auto", False), (5.0, False), ("off", True), (500.0, True)):
        stage = Reconstruct(stage="reconstruct", depth_gate=gate)
        cloud = stage.run(disparity=seen, rig=rig_product(), track=region)
        expected = Status.VALID if kept else Status.BACKGROUND
        assert (cloud["status"][40:60, 30:34] == expected).all()
        assert np.isfinite(cloud["xyz"][40:60, 30:34]).all() == kept


def test_without_a_region_the_whole_photograph_is_matched(pair):
    product = disparity(range=[-40, 60]).run(pair=pair, rig=rig_product())
    assert product["disparity"].shape == pair["left"].shape
    assert product.attrs["origin"] == [0, 0]
    assert product["status"][0, 0] == Status.OUTSIDE
    without_rig = disparity(range=[-40, 60]).run(pair=pair)
    inside = product["status"] != Status.OUTSIDE
    np.testing.assert_array_equal(product["disparity"][inside], without_rig["disparity"][inside])


def test_a_given_range_is_widened_to_a_multiple_of_16(pair, region, matched):
    low, high = matched.attrs["range"]
    assert (high - low) % 16 == 0
    given = disparity(range=[low + 1, high - 3]).run(pair=pair, track=region)
    assert given.attrs["range"] == [low + 1, low + 1 + high - low]


def test_two_runs_are_equal(pair, region, matched):
    again = disparity().run(pair=pair, rig=rig_product(), track=region)
    np.testing.assert_array_equal(again["disparity"], matched["disparity"])


def test_a_step_without_texture(region):
    plain = np.full((480, 640), 100, np.uint8)
    plain += np.random.default_rng(0).integers(0, 2, plain.shape, dtype=np.uint8)
    pair = RECTIFY.run(images=images(plain, plain), rig=rig_product())
    for limits in ("auto", [0, 31]):
        with pytest.raises(StageError, match=r"texture .* gradient is 0\.\d "):
            disparity(range=limits).run(pair=pair, rig=rig_product(), track=region)


def test_a_range_that_holds_nothing(pair, region):
    with pytest.raises(
        StageError, match=r"almost no pixel matches at disparities from 200 to 232 px; .* give another range, or auto"
    ):
        disparity(range=[200, 231]).run(pair=pair, rig=rig_product(), track=region)


def test_photographs_of_two_scenes_have_no_range(pair, region):
    other = photographs_of_plane(RIG, NORMAL, 300.0, shortest_mm=1.7)
    mixed = RECTIFY.run(images=images(other[0], np.flipud(other[1]).copy()), rig=rig_product())
    with pytest.raises(StageError, match="no range of disparities"):
        disparity().run(pair=mixed, rig=rig_product(), track=region)


def test_a_region_beyond_the_photograph(pair):
    with pytest.raises(StageError, match="region lies outside"):
        disparity().run(pair=pair, track=track(rectangle(5000, 5000, 5100, 5100)))


@pytest.mark.parametrize(
    "values",
    [{"range": [40, 8]}, {"range": "wide"}, {"window": 4}, {"refine": 20}, {"texture": float("nan")}, {"speckle": -1}],
)
def test_parameters_are_checked(values):
    with pytest.raises(ValidationError):
        disparity(**values)


@pytest.mark.parametrize("gate", [0.0, -1.0, "near", float("inf")])
def test_depth_gate_is_checked(gate):
    with pytest.raises(ValidationError):
        Reconstruct(stage="reconstruct", depth_gate=gate)


def test_undistorted_dots_lie_where_a_pinhole_puts_them():
    camera = RIG.left
    ideal = np.array([[-0.12, -0.09], [0.0, 0.0], [0.13, 0.1]])
    y, x = np.mgrid[:480, :640]
    dots = distort(camera, ideal)
    photograph = sum(200.0 * np.exp(-((x - u) ** 2 + (y - v) ** 2) / 18.0) for u, v in dots).astype(np.uint8)
    plane = UNDISTORT.run(images=images(photograph), rig=rig_product())
    assert plane.kind == "plane"
    for u, v in ideal @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]:
        part = plane["left"][round(v) - 9 : round(v) + 10, round(u) - 9 : round(u) + 10].astype(float)
        rows, cols = np.mgrid[round(v) - 9 : round(v) + 10, round(u) - 9 : round(u) + 10]
        assert (part * cols).sum() / part.sum() == pytest.approx(u, abs=0.03)
        assert (part * rows).sum() / part.sum() == pytest.approx(v, abs=0.03)


def test_without_a_rig_the_photograph_stays_as_it_is():
    photograph = np.arange(48, dtype=np.uint16).reshape(6, 8)
    np.testing.assert_array_equal(UNDISTORT.run(images=images(photograph))["left"], photograph)


def reference_rig(path):
    """The rig that the reference points were measured with."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    read = {
        name: storage.getNode(name).mat()
        for name in ("cameraMatrix1", "cameraMatrix2", "distCoeffs1", "distCoeffs2", "R", "T")
    }
    left, right = (Camera(read[f"cameraMatrix{k}"], read[f"distCoeffs{k}"].reshape(5), (1920, 1200)) for k in (1, 2))
    return Rig(left, right, read["R"], read["T"].reshape(3))


def test_a_real_specimen_moves_as_another_program_measured(shared_data):
    folder = shared_data / "d_specimen"
    rig = reference_rig(folder / "reference" / "points_0273_rig.yaml")
    view = rectification(rig)
    points = np.genfromtxt(folder / "reference" / "points_0273.csv", delimiter=",", names=True)
    region, moved = track(rectangle(80, 10, 1850, 1000)), []
    for step, names in ((0, ("x", "y")), (273, ("t1_x", "t1_y"))):
        files = [str(folder / side / f"GT4-{step:04d}_{k}.tif") for k, side in enumerate(("left", "right"))]
        pair = RECTIFY.run(
            images=images(*(cv2.imread(file, cv2.IMREAD_GRAYSCALE) for file in files)), rig=rig_product(rig)
        )
        found = disparity().run(pair=pair, rig=rig_product(rig), track=region)
        cloud = Reconstruct(stage="reconstruct").run(disparity=found, rig=rig_product(rig), track=region)
        raw = np.stack([points[name] for name in names], axis=-1)
        places = raw_to_rectified(raw, rig.left, view.rotation_left, view.matrix_left) - cloud.attrs["origin"]
        moved.append(cv2.remap(cloud["xyz"], places[:, None].astype(np.float32), None, cv2.INTER_LINEAR)[:, 0])
    displacement = moved[1] - moved[0]
    expected = np.stack([points[name] for name in "uvw"], axis=-1)
    assert np.isfinite(displacement).all(axis=1).mean() > 0.99
    np.testing.assert_allclose(np.nanmean(displacement, axis=0), expected.mean(axis=0), atol=0.005)
    assert (np.nanstd(displacement - expected, axis=0) < [0.003, 0.004, 0.02]).all()
