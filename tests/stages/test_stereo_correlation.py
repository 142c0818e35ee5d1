"""Stages stereo and triangulate on photographs with exact truth, and on a real specimen measured by others."""

import csv
import json

import cv2
import numpy as np
import pytest
from left_camera import correlation, grid, through_reference
from stereo_scene import (
    REGION,
    REST,
    RIG,
    State,
    left_truth,
    material,
    photographs,
    right_truth,
    space_truth,
)

from dicflow.core.cameras.camera import Camera, Rig
from dicflow.core.correlation import partners
from dicflow.core.correlation.subsets import Subset
from dicflow.core.status import Status
from dicflow.core.tensors import symmetric
from dicflow.core.uncertainty.covariance import MeasuredPoints, displacement_covariance, joint_covariance
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.kinds.rig import CalibratedRig, rig_to_json
from dicflow.stages._window import Offset, with_windows
from dicflow.stages.stereo import Stereo
from dicflow.stages.triangulate import Triangulate

pytestmark = pytest.mark.slow

POINTS = grid(REGION, 12).astype(float)
MATERIAL = material(POINTS)
MOVED = State(stretch=1.05, bulge=-0.2, curl=0.3, turn=(0.05, 0.1, 0.03), shift=(0.5, 0.3, -1.0))
NOISE = 0.5


def images(left, right=None):
    sides = {"left": left} if right is None else {"left": left, "right": right}
    return Product("images", {side: Variable(("row", "col"), image) for side, image in sides.items()})


def rig_product(rig=RIG):
    return Product("rig", {}, {"rig": rig_to_json(rig)})


def tracked(pairs, points=POINTS, states=(REST, MOVED), **options):
    """The product ``correlation`` of the steps."""
    substance, first = material(points, states[0]), pairs[0][0]
    return [
        correlation(first, pair[0] if step else None, points, left_truth(substance, state), **options)
        for step, (pair, state) in enumerate(zip(pairs, states, strict=False))
    ]


def measured(pairs, left, rig=None, **parameters):
    """The products ``stereo`` and ``points`` of the steps."""
    rig, results, last = rig or rig_product(), [], (None, None)
    for k, (pair, step) in enumerate(zip(pairs, left, strict=True)):
        stereo = Stereo(**{"misfit": False, **parameters}).run(
            images=images(*pair),
            images_first=images(*pairs[0]),
            rig=rig,
            correlation=step,
            correlation_first=left[0],
            images_before=images(*pairs[k - 1]) if k else None,
            correlation_before=last[0],
            stereo_first=results[0][0] if k else None,
            stereo_before=last[1],
        )
        first = {"correlation_first": left[0], "stereo_first": results[0][0] if k else stereo}
        points = Triangulate().run(correlation=step, stereo=stereo, rig=rig, **first)
        last = step, stereo
        results.append((stereo, points))
    return results


def triangulated(correlation, stereo, left, results, rig=RIG):
    """Points of a step whose first step is that of some results."""
    return Triangulate().run(
        correlation=correlation,
        correlation_first=left[0],
        stereo=stereo,
        stereo_first=results[0][0],
        rig=rig_product(rig),
    )


@pytest.fixture(scope="module")
def pairs():
    return [photographs(state, NOISE, seed) for seed, state in enumerate((REST, MOVED))]


@pytest.fixture(scope="module")
def left(pairs):
    return tracked(pairs)


@pytest.fixture(scope="module")
def results(pairs, left):
    return measured(pairs, left)


def root_mean_square(values):
    return np.sqrt(np.mean(values**2, axis=(0, 1)))


@pytest.mark.parametrize(("step", "state"), [(0, REST), (1, MOVED)])
def test_the_right_photograph_and_space_are_met(results, step, state):
    stereo, points = results[step]
    assert not stereo["status"].any()
    assert (root_mean_square(stereo["xy"] - right_truth(MATERIAL, state)) < 0.004).all()
    error = points["xyz"] - space_truth(MATERIAL, state)
    assert (root_mean_square(error) < [1.5e-4, 1.5e-4, 8e-4]).all()
    assert (np.abs(error.mean(axis=(0, 1))) < [2e-5, 2e-5, 1e-4]).all()
    assert points["epipolar"].max() < 0.02
    np.testing.assert_allclose(points["reprojection"], 0.5 * points["epipolar"], rtol=0.1)


def test_gradients_are_those_of_the_right_photograph(results):
    stereo = results[1][0]
    for axis, step in enumerate(0.5 * np.eye(2)):
        ahead, back = (right_truth(material(POINTS + s), MOVED) for s in (step, -step))
        assert np.abs(stereo["gradient"][..., axis] - (ahead - back)).max() < 0.004
    np.testing.assert_array_equal(stereo["warp"][..., 1:3], stereo["gradient"])


def test_points_say_what_was_measured(results, left):
    points = results[1][1]
    assert points.attrs["text"] == f"100.0 % of {POINTS[..., 0].size:,} points"
    assert points.attrs["reasons"] == {"valid": 1.0}
    assert points.attrs["depth_mm"] == np.median(points["xyz"][..., 2])
    assert points.attrs["summary"]["valid_share"] == 1.0
    for name in ("step_size", "subset_size", "shape_function", "image_size"):
        assert points.attrs[name] == left[0].attrs[name]
    for name in ("way", "template", "xy"):
        np.testing.assert_array_equal(points[name], left[1][name])
    assert points["covariance"].shape == (*POINTS.shape[:2], 6)
    assert points["sensitivity"].shape == (*POINTS.shape[:2], 3, 2)
    np.testing.assert_array_equal(points["znssd"], np.maximum(left[1]["znssd"], results[1][0]["znssd"]).astype("f4"))
    json.dumps([part.attrs for part in results[1]], allow_nan=False)


def test_a_template_error_moves_the_point_along_the_surface(results):
    points = results[1][1]
    step = 0.5
    for axis, shift in enumerate(step * np.eye(2)):
        ahead, back = (space_truth(material(POINTS + s), MOVED) for s in (shift, -shift))
        np.testing.assert_allclose(points["sensitivity"][..., axis], (ahead - back) / (2 * step), atol=5e-4)


def test_starts_from_the_step_before_lead_to_the_same_place(pairs, left, monkeypatch):
    nearly = REST._replace(turn=(0.0, 0.0, 0.03), shift=(1.0, 0.5, -0.1))
    steps = [pairs[0], photographs(nearly, NOISE, 5)]
    tracks = [left[0], tracked(steps, states=(REST, nearly))[1]]
    searched = count_searches(monkeypatch)
    by_time = measured(steps, tracks, start="time")[1][0]
    assert len(searched) == 1  # at the first step, which has none before it
    by_match = measured(steps, tracks)[1][0]
    assert not by_time["status"].any()
    np.testing.assert_allclose(by_time["xy"], by_match["xy"], atol=2e-3)


def test_where_the_surface_comes_nearer_the_lines_are_searched(pairs, left, monkeypatch):
    searched = count_searches(monkeypatch)
    stereo = measured(pairs, left, start="time")[1][0]
    assert len(searched) == 2
    assert not stereo["status"].any()


def count_searches(monkeypatch):
    calls, search = [], partners.find_partners
    monkeypatch.setattr(partners, "find_partners", lambda *arguments: calls.append(1) or search(*arguments))
    return calls


def test_what_the_right_camera_does_not_see_is_hidden(pairs, left):
    left_image, right = pairs[0]
    covered = right.copy()
    covered[:, :220] = 90
    stereo, points = measured([(left_image, covered)], left[:1])[0]
    seen = right_truth(MATERIAL, REST)[..., 0]
    assert (points["status"][seen > 236.0] == Status.VALID).all()
    reasons = Status.HIDDEN, Status.LOW_CORRELATION
    assert np.isin(points["status"][seen < 200.0], reasons).all()
    assert np.isin(points["status"][seen < 215.0], (*reasons, Status.NO_MATCH)).all()
    assert np.isnan(points["xyz"][seen < 215.0]).all()
    assert np.isnan(stereo["xy"][seen < 215.0]).all()
    shares = points.attrs["reasons"]
    assert sum(shares.values()) == pytest.approx(1.0)
    expected = f"{100 * shares['valid']:.1f} % of {POINTS[..., 0].size:,} points; "
    assert points.attrs["text"].startswith(expected)
    assert "hidden" in points.attrs["text"] or "low correlation" in points.attrs["text"]


def test_the_search_ends_after_as_many_iterations_as_asked(pairs, left):
    """One iteration is not enough for a tolerance that ten reach."""
    stereo, _ = measured(pairs[:1], left[:1], max_iterations=1, tolerance=1e-5)[0]
    assert stereo["iterations"].max() <= 1
    assert (stereo["status"] != Status.VALID).mean() > 0.5


def test_a_right_photograph_that_ends_within_the_region(pairs, left):
    """Points beyond its edge have no value, and nothing stops."""
    left_image, right = pairs[0]
    narrow = rig_product(RIG._replace(right=RIG.right._replace(size=(330, 500))))
    _, points = measured([(left_image, right[:, :330])], left[:1], narrow)[0]
    seen = right_truth(MATERIAL, REST)[..., 0]
    assert (seen > 335.0).any()
    assert (points["status"][seen > 335.0] != Status.VALID).all()
    assert (points["status"][seen < 300.0] == Status.VALID).all()


def test_points_off_their_epipolar_lines_do_not_count(pairs, left):
    moved, part = np.roll(pairs[0][1], 2, axis=0), pairs[0][1].copy()
    part[:, :280] = moved[:, :280]
    stereo, points = measured([(pairs[0][0], part)], left[:1])[0]
    off = right_truth(MATERIAL, REST)[..., 0] < 250.0
    assert 0.2 < off.mean() < 0.5
    assert (stereo["status"][off] == Status.EPIPOLAR).all()
    np.testing.assert_allclose(stereo["epipolar"][off], 2.0, atol=0.1)
    assert np.isnan(points["xyz"][off]).all()
    assert "epipolar" in points.attrs["text"]
    tolerant = measured([(pairs[0][0], moved)], left[:1], max_epipolar=3.0)[0][1]
    assert tolerant.attrs["summary"]["valid_share"] == 1.0
    assert tolerant.attrs["summary"]["epipolar_px"] == pytest.approx(2.0, abs=0.1)


def test_points_that_fit_badly_do_not_count(pairs, left):
    stereo, _ = measured(pairs[:1], left[:1], max_znssd=1e-6)[0]
    assert (stereo["status"] == Status.LOW_CORRELATION).all()


def test_points_lost_in_the_left_photograph_keep_their_reason(pairs, left):
    lost = dict(left[1].variables)
    status, xy = lost["status"].values.copy(), lost["xy"].values.copy()
    status[3, 4], xy[3, 4] = Status.LOW_TEXTURE, np.nan
    lost |= {"status": Variable(("row", "col"), status), "xy": Variable(("row", "col", "a"), xy)}
    step = Product("correlation", lost, left[1].attrs)
    stereo, points = measured(pairs, [left[0], step])[1]
    assert stereo["status"][3, 4] == points["status"][3, 4] == Status.LOW_TEXTURE
    assert (points["status"] == Status.VALID).sum() == points["status"].size - 1
    assert points.attrs["text"] == f"99.9 % of {status.size:,} points; 0.1 % low texture"


def test_left_and_right_exchanged(pairs):
    exchanged = [pair[::-1] for pair in pairs[:1]]
    points = grid((180, 100, 440, 400), 12).astype(float)
    with pytest.raises(StageError, match="exchange left and right"):
        measured(exchanged, [correlation(exchanged[0][0], None, points)])


def test_a_rig_that_does_not_fit_is_explained(pairs, left):
    """The right photograph stands 2 px lower than at the calibration."""
    moved = np.roll(pairs[0][1], 2, axis=0)
    with pytest.raises(
        StageError, match=r"lie 2 px from .* shifted by \(.*, -2.0\) px .* offset: \{right: \[.*, -2\]\}"
    ):
        measured([(pairs[0][0], moved)], left[:1])


WINDOWS = {"left": (40, 30, 500, 440), "right": (60, 20, 520, 460)}


def window(image, side):
    x, y, width, height = WINDOWS[side]
    return np.ascontiguousarray(image[y : y + height, x : x + width])


def test_photographs_of_a_smaller_window_name_its_offset(pairs):
    first = [window(image, side) for image, side in zip(pairs[0], WINDOWS, strict=True)]
    points = POINTS - WINDOWS["left"][:2]
    step = correlation(first[0], None, points, left_truth(MATERIAL, REST) - WINDOWS["left"][:2])
    with pytest.raises(StageError, match=r"600 × 500 px, but this one has 500 × 440 px; .* window .* offset: \{left: "):
        measured([first], [step])


def test_a_window_of_the_sensors_gives_the_same_points(pairs, left, results):
    """Cropped photographs, and the rig with the offset of the windows."""
    first = [window(image, side) for image, side in zip(pairs[0], WINDOWS, strict=True)]
    offset = Offset(left=WINDOWS["left"][:2], right=WINDOWS["right"][:2])
    rig = with_windows(CalibratedRig.write(RIG, "", {}), offset, images(*first))
    points = POINTS - WINDOWS["left"][:2]
    step = correlation(first[0], None, points, points)
    stereo, found = measured([first], [step], rig)[0]
    inner = (results[0][0]["status"] == 0) & (stereo["status"] == 0)
    assert inner.mean() > 0.9
    np.testing.assert_allclose(found["xyz"][inner], results[0][1]["xyz"][inner], atol=1e-3)


def test_photographs_of_different_things(pairs, left):
    other = np.random.default_rng(0).integers(60, 180, pairs[0][1].shape).astype(np.uint8)
    with pytest.raises(StageError, match=r"no point .* right photograph"):
        measured([(pairs[0][0], other)], left[:1])


def test_a_rig_for_another_image_size(pairs, left, results):
    small = RIG._replace(left=RIG.left._replace(size=(300, 250)))
    with pytest.raises(StageError, match=r"300 × 250 .* 600 × 500 "):
        measured(pairs[:1], left[:1], rig=rig_product(small))
    with pytest.raises(StageError, match=r"300 × 250 .* 600 × 500 "):
        triangulated(left[0], results[0][0], left, results, small)


def test_a_right_camera_of_another_size_changes_nothing(pairs, left, results):
    """Rows and columns without the specimen are cut off below and on the right, so no place changes."""
    cut = [(one, np.ascontiguousarray(other[:470, :580])) for one, other in pairs]
    rig = rig_product(RIG._replace(right=RIG.right._replace(size=(580, 470))))
    for (stereo, points), (whole_stereo, whole) in zip(measured(cut, left, rig=rig), results, strict=True):
        np.testing.assert_allclose(stereo["xy"], whole_stereo["xy"], rtol=0, atol=1e-4)
        np.testing.assert_allclose(points["xyz"], whole["xyz"], rtol=0, atol=1e-4)


def test_one_camera_is_not_enough(pairs, left):
    with pytest.raises(StageError, match="add 'right' to the images"):
        measured([(pairs[0][0], None)], left[:1])


TURNED = State(turn=(0.05, 0.1, 0.03), shift=(0.5, 0.3, -1.0))
POINTS_MC = grid(REGION, 20).astype(float)
NOISE_MC, RUNS = 4.0, 7


@pytest.mark.parametrize(
    ("subset", "states"),
    [(Subset(31, "quadratic"), (REST, MOVED)), (Subset(31, "affine"), (State(), TURNED))],
    ids=["one shape function", "another one on the left"],
)
def test_sigma_covers_the_errors(subset, states):
    """1σ covers 68 % and 2σ 95 % of the errors of X, Y, Z at both steps and of U, V, W, under noise."""
    size = scaled_errors(subset, states)
    np.testing.assert_allclose((size < 1.0).mean(axis=1), 0.683, atol=0.03)
    np.testing.assert_allclose((size < 2.0).mean(axis=1), 0.954, atol=0.02)


def test_sigma_covers_the_errors_of_points_chained_through_a_reference():
    """The reference's noise, which leads there and away again, largely cancels."""
    size = scaled_errors(Subset(31, "quadratic"), (REST, MOVED), chained=True)
    np.testing.assert_allclose((size < 1.0).mean(axis=1), 0.683, atol=0.03)
    np.testing.assert_allclose((size < 2.0).mean(axis=1), 0.954, atol=0.02)


def scaled_errors(subset, states, chained=False, **parameters):
    """Errors over their σ (9, n), of X, Y, Z at the second step, at the first, and of U, V, W."""
    substance, scaled = material(POINTS_MC, states[0]), []
    for run in range(RUNS):
        pairs = [photographs(state, NOISE_MC, seed=10 * run + step) for step, state in enumerate(states)]
        left = tracked(pairs, POINTS_MC, states, noise=np.hypot(NOISE_MC, 12**-0.5), subset=subset)
        if chained:
            places, between = left_truth(substance, states[1]), photographs(states[1], NOISE_MC, seed=1000 + run)
            noise = np.hypot(NOISE_MC, 12**-0.5)
            step = tracked([pairs[0], between], POINTS_MC, states, noise=noise, subset=subset)[1]
            left[1] = through_reference(step, between[0], pairs[1][0], places)
        before, after = (found for _, found in measured(pairs, left, **parameters))
        for way in ("way", "way_right"):
            assert ((after[way] == 2).mean() > 0.99) == chained
        joint = joint_covariance(errors_of(after), errors_of(before), symmetric(before["template"]))
        misses = [
            found["xyz"] - space_truth(substance, state) for found, state in zip((before, after), states, strict=True)
        ]
        sigma = (joint[..., :3, :3], joint[..., 3:, 3:], displacement_covariance(joint))
        errors = (misses[1], misses[0], misses[1] - misses[0])
        scaled.append([e / np.sqrt(np.diagonal(c, axis1=-2, axis2=-1)) for e, c in zip(errors, sigma, strict=True)])
    size = np.abs(np.array(scaled)).transpose(1, 4, 0, 2, 3).reshape(9, -1)
    return size[:, np.isfinite(size).all(axis=0)]


def errors_of(points):
    return MeasuredPoints(points["xyz"], symmetric(points["covariance"]), points["sensitivity"])


def test_what_the_way_through_a_later_reference_adds_is_common_to_both_photographs(results, left):
    """A chained point of known errors, without images: its covariance is that of many draws."""
    stereo, step = results[1][0], left[1]
    common, alone = np.array([[9e-4, 2e-4], [2e-4, 4e-4]]), np.array([[2e-4, -5e-5], [-5e-5, 1e-4]])
    by_left, by_right = step["gradient"], stereo["gradient"]
    upper = (slice(None), slice(None), [0, 0, 1], [0, 1, 1])
    chained = dict(step.variables) | {
        "covariance": Variable(("row", "col", "a"), (by_left @ (common + alone) @ np.swapaxes(by_left, -1, -2))[upper]),
        "passed": Variable(("row", "col", "a"), (by_left @ common @ np.swapaxes(by_left, -1, -2))[upper]),
        "way": Variable(("row", "col"), np.full(step["way"].shape, 2, np.uint8)),
    }
    right = dict(stereo.variables) | {
        "way": Variable(("row", "col"), np.full(step["way"].shape, 2, np.uint8)),
        "covariance": Variable(("row", "col", "a"), (by_right @ alone @ np.swapaxes(by_right, -1, -2))[upper]),
    }

    def run(shift_left, shift_right):
        moved_left = chained | {"xy": Variable(("row", "col", "a"), step["xy"] + shift_left)}
        moved_right = right | {"xy": Variable(("row", "col", "a"), stereo["xy"] + shift_right)}
        moved = Product("correlation", moved_left, step.attrs), Product("stereo", moved_right, stereo.attrs)
        return triangulated(*moved, left, results)

    exact = run(0.0, 0.0)
    factor = np.linalg.inv(np.linalg.cholesky(symmetric(exact["covariance"])))
    generator, shape, scatter = np.random.default_rng(0), POINTS.shape[:2], []
    for _ in range(4):
        way, one, other = (generator.multivariate_normal([0, 0], c, shape) for c in (common, alone, alone))
        shifts = (slopes @ (way + part)[..., None] for slopes, part in ((by_left, one), (by_right, other)))
        error = run(*(shift[..., 0] for shift in shifts))["xyz"] - exact["xyz"]
        scatter.append((factor @ error[..., None])[..., 0].reshape(-1, 3))
    found = np.concatenate(scatter)
    np.testing.assert_allclose(found.T @ found / len(found), np.eye(3), atol=4 * np.sqrt(2 / len(found)))


def test_d_specimen_agrees_with_another_program(shared_data):
    """Step 0 → 273 at every second of the reference's points: left image, U, V and W."""
    folder = shared_data / "d_specimen"
    with (folder / "reference/points_0273.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if int(row["x"]) % 2 == int(row["y"]) % 2 == 0]
    column = {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}
    (xs, j), (ys, i) = (np.unique(column[axis], return_inverse=True) for axis in "xy")
    points, moved = np.full((2, len(ys), len(xs), 2), np.nan)
    points[i, j] = np.stack([column["x"], column["y"]], axis=-1)
    moved[i, j] = np.stack([column["t1_x"], column["t1_y"]], axis=-1)
    pairs = [
        [cv2.imread(str(folder / side / f"GT4-{step}_{index}.tif"), cv2.IMREAD_GRAYSCALE) for index, side in SIDES]
        for step in ("0000", "0273")
    ]
    start = (points, moved)
    left = [
        correlation(
            pairs[0][0], pair[0] if step else None, points, start[step], noise=2.0, subset=Subset(31, "quadratic")
        )
        for step, pair in enumerate(pairs)
    ]
    before, after = (found for _, found in measured(pairs, left, rig=rig_product(_reference_rig(folder))))
    ours = (after["xyz"] - before["xyz"])[i, j]
    theirs = np.stack([column[f"tar_{axis}"] - column[f"ref_{axis}"] for axis in "xyz"], axis=-1)
    known = np.isfinite(ours).all(axis=1)
    assert known.mean() > 0.99
    assert (np.abs(np.median((ours - theirs)[known], axis=0)) < [0.001, 0.001, 0.002]).all()
    apart = np.linalg.norm(after["xy"][i, j] - moved[i, j], axis=1)
    assert np.median(apart[known]) < 0.03


SIDES = ((0, "left"), (1, "right"))


def _reference_rig(folder):
    """The rig that the reference's points were triangulated with."""
    file = cv2.FileStorage(str(folder / "reference/points_0273_rig.yaml"), cv2.FILE_STORAGE_READ)
    cameras = [
        Camera(file.getNode(f"cameraMatrix{n}").mat(), file.getNode(f"distCoeffs{n}").mat().ravel(), (1920, 1200))
        for n in (1, 2)
    ]
    return Rig(*cameras, file.getNode("R").mat(), file.getNode("T").mat().ravel())


def test_a_bias_of_the_left_places_moves_the_points_as_both_places_do(results, left):
    """Subsets are off by the same part of the material in both photographs: against shifted places."""
    stereo, step = results[1][0], left[1]
    bias = np.broadcast_to([0.01, 0.02], step["xy"].shape)
    across = stereo["gradient"] @ np.linalg.inv(step["gradient"])

    def run(shift):
        arrays = {"xy": step["xy"] + shift, "bias": bias}
        moved = {name: Variable(("row", "col", "a"), values) for name, values in arrays.items()}
        right = {"xy": Variable(("row", "col", "a"), stereo["xy"] + across @ shift)}
        found = Product("correlation", {**step.variables, **moved}, step.attrs)
        return triangulated(found, Product("stereo", {**stereo.variables, **right}, stereo.attrs), left, results)

    exact = run(np.zeros(2))
    for axis in range(2):
        moved = run(0.01 * (axis + 1) * np.eye(2)[axis])["xyz"] - exact["xyz"]
        np.testing.assert_allclose(exact["bias"][..., axis], moved, rtol=2e-2, atol=2e-6)


def test_rays_that_miss_each_other_alike_at_all_steps_do_not_move_the_points(results, left):
    """A rig that does not fit is not taken for a displacement where the noise differs from step to step."""

    def shifted(product, noisier=1.0):
        arrays = {
            "xy": Variable(("row", "col", "a"), product["xy"] + [0.0, 0.1]),
            "covariance": Variable(("row", "col", "a"), noisier * product["covariance"]),
        }
        return Product("stereo", {**product.variables, **arrays}, product.attrs)

    first, rest = shifted(results[0][0]), shifted(results[0][0], 16.0)
    before, after = (triangulated(left[0], one, left, [(first, None)])["xyz"] for one in (first, rest))
    fitting = triangulated(left[0], results[0][0], left, results)["xyz"]
    assert np.nanmax(np.abs(before - fitting)) > 1e-3
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-9)
