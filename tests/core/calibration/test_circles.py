import numpy as np
import pytest
from boards import board_corners, verged_rig

from dicflow.core.calibration.bundle import LensModel
from dicflow.core.calibration.calibrate import calibrate_rig
from dicflow.core.calibration.circles import (
    Ellipses,
    circle_points,
    circle_target,
    eccentricity,
    find_circles,
    fit_ellipses,
)
from dicflow.core.cameras.camera import Camera, camera_matrix, rotation_angle_deg, rotation_matrix
from dicflow.core.synthetic.circles import CircleGrid, circle_centres, circle_darkness, circle_extent
from dicflow.core.synthetic.deformation import Deformation
from dicflow.core.synthetic.render import GreyLevels, add_noise_and_round, photograph
from dicflow.core.synthetic.trace import image_of

pytestmark = pytest.mark.slow

CAMERA = Camera(camera_matrix(2000.0, [399.0, 301.0]), np.array([-0.1, 0.2, 4e-4, -3e-4, 0.0]), (800, 600))
LOOK = GreyLevels(paper=205.0, ink=34.0)
SYMMETRIC = CircleGrid(9, 6, 14.5, 5.5, edge=0.3)
ASYMMETRIC = CircleGrid(4, 11, 9.0, 4.5, asymmetric=True, margin=12.0, edge=0.3)


def view(grid, tilt_deg, camera=CAMERA, distance=480.0):
    """Photograph of a grid before noise, and where its centres are (n, 2)."""
    extent = circle_extent(grid)
    middle = np.array([extent.left + extent.right, extent.top + extent.bottom, 0.0]) / 2.0
    rotation = rotation_matrix(np.radians(tilt_deg))
    pose = Deformation(1.0, 1.0, rotation=rotation, translation=np.array([0.0, 0.0, distance]) - rotation @ middle)
    image = photograph(camera, pose, extent, lambda points: circle_darkness(grid, points), LOOK, 3)
    return image, image_of(camera, pose, circle_centres(grid)).reshape(-1, 2)


def rms(error):
    return float(np.sqrt(np.mean(error**2)))


def nearest_order(found, truth):
    return min((found, found[::-1]), key=lambda order: rms(order - truth))


@pytest.fixture(scope="module", params=["symmetric", "asymmetric"])
def tilted(request):
    grid = SYMMETRIC if request.param == "symmetric" else ASYMMETRIC
    return grid, *view(grid, (22.0, 24.0, -10.0))


def test_centres_are_found_where_they_are(tilted):
    grid, image, truth = tilted
    for noise, bar in ((0.0, 0.005), (2.0, 0.006)):
        found = find_circles(add_noise_and_round(image, noise, [1]), (grid.columns, grid.rows), grid.asymmetric)
        error = nearest_order(found, truth) - truth
        assert rms(error) < bar
        assert np.abs(error.mean(axis=0)).max() < 0.0015


def test_without_the_correction_for_perspective_they_are_not(tilted):
    """The ellipses' centres are off by 0.05 px and more, of which the correction leaves a fiftieth at most."""
    grid, image, truth = tilted
    points = circle_points((grid.columns, grid.rows), 1.0, grid.asymmetric)[:, :2]
    cells = np.broadcast_to(50.0 * np.eye(2), (len(truth), 2, 2))
    ellipses = fit_ellipses(add_noise_and_round(image, 0.0, [1]), truth, cells)
    bias = ellipses.centres - truth
    assert rms(bias) > 0.05
    assert np.linalg.norm((bias - eccentricity(ellipses, points)).mean(axis=0)) < 0.02 * rms(bias)


def test_eccentricity_of_one_view_is_that_of_the_conics():
    """A tilt θ of a plane at distance Z: the centre of the image of a circle of radius ρ is shifted along the tilt by
    f ρ² sin θ cos θ / (Z² − ρ² sin² θ)."""
    focal, distance, radius, tilt = 2000.0, 480.0, 6.0, np.radians(35.0)
    rotation = rotation_matrix([0.0, tilt, 0.0])
    points = circle_points((3, 3), 20.0)[:, :2] - 20.0
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    rims = points[:, None] + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def seen(at):
        space = np.concatenate([at, np.zeros((*at.shape[:-1], 1))], axis=-1) @ rotation.T + [0.0, 0.0, distance]
        return focal * space[..., :2] / space[..., 2:]

    conics = [np.linalg.lstsq(np.stack([x * x, x * y, y * y, x, y], axis=-1), np.ones_like(x), rcond=None)[0]
              for x, y in np.moveaxis((seen(rims) - seen(points)[:, None]) / 30.0, -1, 1)]  # fmt: skip
    quadratic = np.array([[[a, b / 2.0], [b / 2.0, c]] for a, b, c, _, _ in conics])
    offset = np.array([-np.linalg.solve(2.0 * q, conic[3:]) for q, conic in zip(quadratic, conics, strict=True)])
    level = np.array([1.0 + o @ q @ o for o, q in zip(offset, quadratic, strict=True)])
    ellipses = Ellipses(seen(points) + 30.0 * offset, 900.0 * np.linalg.inv(quadratic / level[:, None, None]))
    found = eccentricity(ellipses, points)
    expected = focal * radius**2 * np.sin(tilt) * np.cos(tilt) / (distance**2 - (radius * np.sin(tilt)) ** 2)
    assert abs(found[4, 0]) == pytest.approx(expected, rel=0.01)
    np.testing.assert_allclose(found, 30.0 * offset, atol=0.01 * expected)


def test_white_circles_on_black(tilted):
    grid, image, truth = tilted
    found = find_circles(255 - add_noise_and_round(image, 2.0, [1]), (grid.columns, grid.rows), grid.asymmetric)
    assert rms(nearest_order(found, truth) - truth) < 0.006


def test_deeper_grey_levels_give_the_same_centres(tilted):
    grid, image, _ = tilted
    plain = add_noise_and_round(image, 0.0, [1])
    size = (grid.columns, grid.rows)
    deep = find_circles(plain.astype(np.uint16) * 200 + 1000, size, grid.asymmetric)
    np.testing.assert_allclose(deep, find_circles(plain, size, grid.asymmetric), atol=1e-6)


@pytest.mark.parametrize("size", [(8, 6), (9, 5), (10, 6), (5, 11)])
def test_a_grid_of_another_size_is_not_found(tilted, size):
    """Least of all as a part of the grid that is there: nobody knew which part."""
    grid, image, _ = tilted
    assert find_circles(add_noise_and_round(image, 2.0, [1]), size, grid.asymmetric) is None


def test_a_part_of_an_asymmetric_grid_is_not_taken_for_a_grid(tilted):
    grid, image, _ = tilted
    if grid.asymmetric:
        assert find_circles(add_noise_and_round(image, 2.0, [1]), (4, 9), True) is None
        assert find_circles(add_noise_and_round(image, 2.0, [1]), (3, 11), True) is None


def test_without_a_grid_the_result_is_none():
    assert find_circles(np.full((300, 400), 128, np.uint8), (9, 6)) is None


def test_large_photographs_are_searched_at_a_smaller_scale():
    """Circles of 70 px, whose centres are as exact as those of small ones."""
    camera = Camera(camera_matrix(4000.0, [799.0, 601.0]), np.zeros(5), (1600, 1200))
    grid = CircleGrid(7, 5, 18.0, 4.3, edge=0.2)
    image, truth = view(grid, (15.0, -20.0, 4.0), camera)
    found = find_circles(add_noise_and_round(image, 2.0, [1]), (7, 5))
    assert rms(nearest_order(found, truth) - truth) < 0.008


@pytest.mark.parametrize(("size", "asymmetric", "count"), [((9, 6), False, 2), ((6, 6), False, 4), ((4, 11), True, 1),
                                                           ((4, 10), True, 2)])  # fmt: skip
def test_orders_are_the_turns_that_keep_the_grid(size, asymmetric, count):
    target = circle_target(size, 1.0, asymmetric)
    assert len(target.orders) == count
    centred = target.points[:, :2] - target.points[:, :2].mean(axis=0)
    for order in target.orders:
        turn = np.linalg.lstsq(centred, centred[order], rcond=None)[0]
        np.testing.assert_allclose(centred @ turn, centred[order], atol=1e-9)
        assert np.linalg.det(turn) == pytest.approx(1.0)


@pytest.mark.parametrize(("size", "asymmetric"), [((9, 6), False), ((6, 6), False), ((4, 10), True), ((4, 11), True)])
def test_turned_grids_are_reconciled(size, asymmetric):
    """Each photograph of either camera may have come in any of the orders that the grid allows."""
    rig, target = verged_rig(), circle_target(size, 7.0, asymmetric)
    generator = np.random.default_rng(1)
    sides = [side.copy() for side in board_corners(rig, board=target.points)]
    chosen = generator.integers(len(target.orders), size=(2, len(sides[0])))
    for side, orders in zip(sides, chosen, strict=True):
        for view, order in zip(side, orders, strict=True):
            view[:] = view[target.orders[order]]
    found = calibrate_rig(*sides, target, ((640, 480),) * 2, LensModel(2, True))
    assert found.rms_px[2] < 1e-6
    assert rotation_angle_deg(found.rig.rotation, rig.rotation) < 1e-6
    np.testing.assert_allclose(found.rig.translation, rig.translation, atol=1e-4)
    if len(target.orders) == 2:
        np.testing.assert_array_equal(found.turned, chosen[0] != chosen[1])
