"""Explanations of rigs that do not fit, from exact points with noise: the cause is always known."""

import re

import numpy as np
import pytest
from boards import swapped, verged_rig

from dicflow.core.cameras.camera import project, resized, rotation_matrix, to_right, windowed
from dicflow.core.cameras.epipolar import epipolar_distance
from dicflow.core.cameras.rig_misfit import Matched, explain_misfit
from dicflow.core.cameras.triangulate import triangulate

pytestmark = pytest.mark.slow

RIG = verged_rig()
GENERATOR = np.random.default_rng(4)
FLAT = np.append(GENERATOR.uniform([-40, -30], [40, 30], (400, 2)), np.full((400, 1), 400.0), axis=1)
CURVED = FLAT + np.array([0.0, 0.0, 1.0]) * (8.0 * np.cos(FLAT[:, :1] / 20.0))
NOISE = 0.2


def seen(rig, points=CURVED, noise=NOISE):
    """Both photographs' points [px], a tenth of them wrong."""
    generator = np.random.default_rng(7)
    pair = [project(rig.left, points), project(rig.right, to_right(rig, points))]
    left, right = (xy + generator.normal(0.0, noise, xy.shape) for xy in pair)
    right[:40] += generator.uniform(-30.0, 30.0, (40, 2))
    return left, right


def explained(rig, left, right, sizes=(RIG.left.size, RIG.right.size)):
    return explain_misfit(rig, Matched(left, right, sizes), 1.0)


def offsets(found):
    """The offsets that a remedy names."""
    places = re.search(r"set offset: \{(.*?)\}", found.remedy).group(1)
    return {side: [float(x), float(y)] for side, x, y in re.findall(r"(\w+): \[(-?\d+), (-?\d+)\]", places)}


def test_a_rig_that_fits_is_not_explained():
    assert explained(RIG, *seen(RIG)) is None
    assert explained(RIG, *(xy[:0] for xy in seen(RIG))) is None


def test_exchanged_photographs():
    found = explained(RIG, *seen(RIG)[::-1])
    assert (found.cause, found.remedy) == ("left and right photographs look swapped", "exchange left and right")
    assert found.explained_px < 0.3 < found.distance_px
    assert "exchange left and right" in explained(swapped(RIG), *seen(RIG)).text


@pytest.mark.parametrize("scale", [0.5, 0.25, 1.5])
def test_another_resolution(scale):
    sizes = tuple((round(scale * one.size[0]), round(scale * one.size[1])) for one in (RIG.left, RIG.right))
    cameras = [resized(one, size) for one, size in zip((RIG.left, RIG.right), sizes, strict=True)]
    found = explained(RIG, *seen(RIG._replace(left=cameras[0], right=cameras[1])), sizes)
    assert found.cause == f"the photographs look scaled by {scale:g}"
    assert found.explained_px < 0.3


def test_another_resolution_and_the_cameras_exchanged():
    half = RIG._replace(left=resized(RIG.left, (320, 240)), right=resized(RIG.right, (320, 240)))
    found = explained(RIG, *seen(half)[::-1], ((320, 240), (320, 240)))
    assert found.cause == "left and right photographs look swapped, and the photographs look scaled by 0.5"
    assert found.remedy.startswith("exchange left and right, and ")


def test_one_camera_in_another_resolution():
    half = resized(RIG.right, (320, 240))
    found = explained(RIG, *seen(RIG._replace(right=half)), ((640, 480), (320, 240)))
    assert found.cause == "the photographs look scaled by 1 (left) and 0.5 (right)"


def test_resized_photographs_keep_their_places():
    """A point at the photograph's edge stays there: the edge lies half a pixel outside the first pixel's centre."""
    twice = resized(RIG.left, (1280, 960))
    rays = np.array([[0.01, 0.02], [-0.1, 0.05]])
    points = np.append(rays, np.ones((2, 1)), axis=1)
    np.testing.assert_allclose(project(twice, points) + 0.5, 2.0 * (project(RIG.left, points) + 0.5))


@pytest.mark.parametrize("sides", [("left",), ("right",), ("left", "right")])
def test_photographs_turned_by_half_a_turn(sides):
    pair = dict(zip(("left", "right"), seen(RIG), strict=True))
    turned = {side: [639.0, 479.0] - xy if side in sides else xy for side, xy in pair.items()}
    found = explained(RIG, turned["left"], turned["right"])
    assert found.cause == f"the {' and '.join(sides)} photographs look turned by 180°"


@pytest.mark.parametrize("points", [FLAT, CURVED], ids=["flat", "curved"])
@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("place", [(60, 40), (0, 25), (-20, 8)])
def test_a_window_of_one_camera_at_another_place(side, place, points):
    """Of equal size, so that only the epipolar lines tell."""
    camera = windowed(getattr(RIG, side), place, (640, 480))
    found = explained(RIG, *seen(RIG._replace(**{side: camera}), points))
    assert "shifted by" in found.cause
    (named,) = offsets(found)
    across = 1.0 if named == side else -1.0  # across the baseline the other camera's window has the opposite effect
    assert offsets(found)[named][1] == pytest.approx(
        across * place[1], abs=3.0 if named == side else 0.1 * place[1] + 3
    )
    assert found.explained_px < 0.3


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_smaller_window_of_one_camera(side):
    other = windowed(getattr(RIG, side), (70, 30), (500, 400))
    rig = RIG._replace(**{side: other})
    found = explained(RIG, *seen(rig), (rig.left.size, rig.right.size))
    assert list(offsets(found)) == [side]
    np.testing.assert_allclose(offsets(found)[side], (70, 30), atol=4.0)


def test_equal_smaller_windows_of_both_cameras():
    cameras = [windowed(one, (80, 60), (480, 360)) for one in (RIG.left, RIG.right)]
    rig = RIG._replace(left=cameras[0], right=cameras[1])
    found = explained(RIG, *seen(rig), (rig.left.size, rig.right.size))
    assert "in the left and right photographs" in found.cause
    np.testing.assert_allclose(list(offsets(found).values()), 2 * [(80, 60)], atol=6.0)
    assert found.explained_px < 0.3


def test_different_smaller_windows_of_both_cameras():
    """Only the difference across the baseline shows clearly; the remedy leads the points to their lines."""
    cameras = [windowed(one, place, (480, 360)) for one, place in ((RIG.left, (20, 60)), (RIG.right, (90, 80)))]
    rig = RIG._replace(left=cameras[0], right=cameras[1])
    left, right = seen(rig)
    found = explained(RIG, left, right, (rig.left.size, rig.right.size))
    by = offsets(found)
    named = RIG._replace(
        left=windowed(RIG.left, by["left"], (480, 360)), right=windowed(RIG.right, by["right"], (480, 360))
    )
    assert np.median(epipolar_distance(named, left, right)) < 1.0
    assert by["right"][1] - by["left"][1] == pytest.approx(20.0, abs=4.0)


def test_another_rig():
    moved = RIG._replace(rotation=rotation_matrix([0.0, 0.15, 0.3]) @ RIG.rotation)
    found = explained(moved, *seen(RIG))
    assert "neither exchanged nor scaled" in found.cause
    assert np.isnan(found.explained_px)
    assert "use the calibration of these cameras" in found.text


def test_the_distance_is_that_of_the_points():
    found = explained(RIG, *(xy + shift for xy, shift in zip(seen(RIG), ([0.0, 0.0], [0.0, 12.0]), strict=True)))
    assert found.points == 400
    assert found.distance_px == pytest.approx(12.0, abs=0.5)
    assert "400 matched features lie 12 px from their epipolar lines" in found.text


def test_a_window_gives_the_same_points_in_space():
    """The rig for windows of the sensors, with the pixels counted from the windows' corners."""
    cameras = windowed(RIG.left, (80, 60), (480, 360)), windowed(RIG.right, (30, 20), (600, 440))
    rig = RIG._replace(left=cameras[0], right=cameras[1])
    left, right = project(RIG.left, CURVED), project(RIG.right, to_right(RIG, CURVED))
    found = triangulate(rig, left - [80.0, 60.0], right - [30.0, 20.0]).xyz
    np.testing.assert_allclose(found, CURVED, atol=1e-9)
