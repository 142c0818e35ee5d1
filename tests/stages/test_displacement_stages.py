import numpy as np
import pytest
from analytic import SCALE, affine, cloud, track, tracks

from dicflow.core.status import Status
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.stages.displacement import Displacement
from dicflow.stages.smooth import Smooth

HALF = affine(yy=1.2, xx=0.95)


def with_status(product, where, code):
    status = product["status"].copy()
    status[where] = code
    variables = {**product.variables, "status": Variable(("row", "col"), status)}
    return Product(product.kind, variables, product.attrs)


def test_perfect_displacement_on_a_tilted_plane():
    steps = tracks([np.eye(3), HALF])
    result = Displacement().run(
        track=steps[1], track_before=steps[0], cloud=cloud((0.3, -0.2), 480.0), cloud_before=cloud((0.3, -0.2), 500.0)
    )
    moved = SCALE * (steps[1]["points"] - steps[0]["points"])
    truth = np.concatenate([moved, moved @ np.array([[0.3], [-0.2]]) - 20.0], axis=-1)
    assert np.abs(result["displacement"] - truth).max() < 1e-9
    assert np.array_equal(result["xy"], steps[1]["points"])
    assert not result["status"].any()
    assert result.attrs["unit"] == "mm"
    assert result.attrs["step_size"] == 5.0
    assert result.attrs["summary"] == {"measured_share": 1.0}
    assert result.variables["displacement"].units == "mm"


def test_one_camera():
    steps = tracks([np.eye(3), HALF])
    result = Displacement().run(track=steps[1], track_before=steps[0])
    assert np.allclose(result["displacement"][..., :2], steps[1]["points"] - steps[0]["points"])
    assert np.all(result["xyz"][..., 2] == 0.0)
    assert result.variables["displacement"].units == "px"


def test_one_cloud_of_two_is_refused():
    steps = tracks([np.eye(3), HALF])
    with pytest.raises(StageError, match="cloud_before"):
        Displacement().run(track=steps[1], track_before=steps[0], cloud=cloud())


def test_status_comes_through():
    steps = tracks([np.eye(3), np.eye(3)])
    before = with_status(steps[0], (slice(0, 2), slice(None)), Status.FILLED)
    result = Displacement().run(track=steps[1], track_before=before)
    assert np.all(result["status"][:2] == Status.FILLED)
    assert np.all(result["status"][2:] == Status.VALID)


def test_thesis_definition_stands_on_the_deformed_region():
    steps = tracks([np.eye(3), HALF])
    surface = cloud()
    result = Displacement(definition="thesis").run(
        track=steps[1], track_before=steps[0], cloud=surface, cloud_before=surface
    )
    known = np.isfinite(result["displacement"][..., 1])
    y = result["xy"][..., 1][known]
    truth = SCALE * (y - 40.0) * (1 - 1 / 1.2)
    assert result.attrs["step_size"] == 3.0
    assert known.mean() > 0.9
    error = np.abs(result["displacement"][..., 1][known] - truth)
    per_px = SCALE * (1 - 1 / 1.2)
    assert error[result["status"][known] == Status.VALID].max() < 1.5 * per_px + 1e-9
    assert error.max() < (7 * 3 / 2) * per_px  # a filled point is the mean of up to half a window beside it
    assert (y.min(), y.max()) == pytest.approx((40.0, 40.0 + 120 * 1.2), abs=3.0)


def test_smoothing_keeps_a_parabola_and_takes_off_noise():
    """What remains of noise in a full window of degree 2 is σ √leverage."""
    steps = tracks([np.eye(3), HALF])
    noise = np.random.default_rng(0).normal(0, 0.02, (*steps[0]["points"].shape[:2], 2))
    noisy = Product(
        "track",
        {**steps[1].variables, "points": Variable(("row", "col", "component"), steps[1]["points"] + noise)},
        steps[1].attrs,
    )
    exact = Displacement().run(track=steps[1], track_before=steps[0])
    raw = Displacement().run(track=noisy, track_before=steps[0])
    node = Smooth(window=(60, 30))
    assert np.abs(node.run(increment=exact)["displacement"] - exact["displacement"]).max() < 1e-10
    smooth = node.run(increment=raw)
    error = (smooth["displacement"] - exact["displacement"])[6:-6, 3:-3, :2]
    row, col = (axis.ravel() for axis in np.mgrid[-6:7, -3:4])
    design = np.stack([np.ones(91), row, col, row**2, row * col, col**2], axis=1)
    leverage = np.linalg.inv(design.T @ design)[0, 0]
    assert error.std() == pytest.approx(0.02 * np.sqrt(leverage), rel=0.5)
    assert np.allclose(smooth["xyz"], smooth["xyz_reference"] + smooth["displacement"])
    assert smooth.attrs["window_points"] == [13, 7]
    assert smooth.attrs["summary"]["change_rms_px"] == pytest.approx(0.02 * np.sqrt(2 / 3 * (1 - leverage)), rel=0.15)


def test_smoothing_leaves_holes_open():
    steps = tracks([np.eye(3), HALF])
    points = steps[1]["points"].copy()
    points[4:6, 4:6] = np.nan
    holed = Product(
        "track", {**steps[1].variables, "points": Variable(("row", "col", "component"), points)}, steps[1].attrs
    )
    raw = Displacement().run(track=holed, track_before=steps[0])
    smooth = Smooth(window=(40, 20)).run(increment=raw)
    assert np.array_equal(np.isnan(smooth["displacement"]), np.isnan(raw["displacement"]))
    assert np.array_equal(smooth["status"], raw["status"])


def test_a_window_too_small_is_refused():
    steps = tracks([np.eye(3), HALF])
    increment = Displacement().run(track=steps[1], track_before=steps[0])
    with pytest.raises(StageError, match=r"3 × 3 points .*degree 3"):
        Smooth(window=(5, 5), degree=3).run(increment=increment)


def test_a_step_without_any_point_stays_empty():
    lost = track(np.eye(3))
    points = np.full_like(lost["points"], np.nan)
    empty = Product("track", {**lost.variables, "points": Variable(("row", "col", "component"), points)}, lost.attrs)
    result = Smooth().run(increment=Displacement().run(track=empty, track_before=track(np.eye(3))))
    assert np.isnan(result["displacement"]).all()
    assert result.attrs["summary"] == {"change_rms_px": 0.0}
