"""The total from measured points: known fields, what is taken out, and that σ covers the errors."""

import json

import numpy as np
import pytest
from looking import ran
from measured_points import (
    MM_PX,
    RIG,
    SHAPE,
    STEP_SIZE,
    SUBSET_SIZE,
    correlation,
    first_points,
    grid_px,
    points,
    sheet,
    template_errors,
)

from dicflow.core.cameras.camera import rotation_matrix
from dicflow.core.cameras.rig_parameters import rig_after_step
from dicflow.core.cameras.triangulate import triangulate
from dicflow.core.status import Status
from dicflow.engine.product import Product, Variable
from dicflow.engine.work import is_kept
from dicflow.errors import StageError
from dicflow.kinds.rig import rig_to_json
from dicflow.stages.deformation import Deformation
from dicflow.stages.maps import Maps
from tests.noise import point_errors

STRETCH = np.diag([2.3**-0.5, 2.3, 1.0])
FLAT = sheet()
CENTRE = FLAT.mean(axis=(0, 1))


def deformed(gradient, xyz=FLAT, turn=(0, 0, 0), shift=(0, 0, 0)):
    return ((xyz - CENTRE) @ np.asarray(gradient).T) @ rotation_matrix(turn).T + CENTRE + shift


def total(after, before=FLAT, **parameters):
    stage = Deformation(**{"window": 50, **parameters})
    return stage.run(points=points(after), points_first=first_points(before))


def test_uniaxial_stretch_of_2_3():
    result = total(deformed(STRETCH))
    expected = {"exx": 2.3**-0.5 - 1, "eyy": 1.3, "gxy": 0, "e1": 1.3, "e2": 2.3**-0.5 - 1, "rotation": 0}
    for name, value in {**expected, "von_mises": np.log(2.3), "area_change": 2.3**0.5 - 1}.items():
        assert np.abs(result[name] - value).max() < 1e-9
    assert np.abs(result["V"] - 1.3 * (FLAT - CENTRE)[..., 1]).max() < 1e-9
    assert not result["status"].any()
    assert result.attrs["summary"]["mean_eyy"] == pytest.approx(1.3)
    assert result.attrs["summary"]["valid_share"] == 1.0
    json.dumps(result.attrs, allow_nan=False)


@pytest.mark.parametrize("rigid", [False, True])
def test_rigid_motion_has_no_strain_and_can_be_taken_out(rigid):
    motion = {"turn": (0.1, -0.2, 0.15), "shift": (5.0, -3.0, 20.0)}
    result = total(deformed(np.eye(3), **motion), rigid=rigid)
    assert max(np.abs(result[name]).max() for name in ("exx", "eyy", "gxy", "e1")) < 1e-9
    if rigid:
        assert max(np.abs(result[name]).max() for name in "UVW") < 1e-9
        assert np.allclose(result.attrs["rigid"]["rotation_deg"], np.degrees(motion["turn"]))
        assert np.allclose(result.attrs["rigid"]["translation"], motion["shift"])
    else:
        assert result.attrs["rigid"] is None
        assert result.attrs["summary"]["mean_W_mm"] == pytest.approx(20.0)


def test_measure_and_directions():
    turned = deformed(STRETCH, turn=(0, 0, np.pi / 6))
    material = total(turned, measure="hencky")
    assert np.abs(material["eyy"] - np.log(2.3)).max() < 1e-9
    assert np.abs(material["rotation"] - 30.0).max() < 1e-9
    present = total(turned, measure="green_lagrange", directions="global")
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    strain = [(1 / 2.3 - 1) / 2, (2.3**2 - 1) / 2]
    assert np.abs(present["exx"] - (c**2 * strain[0] + s**2 * strain[1])).max() < 1e-9
    assert "Green–Lagrange" in present.attrs["measures"]["exx"]
    assert "global" in present.attrs["measures"]["exx"]


def test_gauge_in_px_and_mm():
    result = total(FLAT)
    assert result.attrs["window_points"] == [7, 7]
    assert result.attrs["vsg_px"] == 6 * STEP_SIZE + SUBSET_SIZE
    assert result.attrs["vsg_mm"] == pytest.approx(MM_PX * result.attrs["vsg_px"])


def test_a_frame_turns_the_result():
    tilted = sheet((0.5, 0.0))
    axis = np.array([1.0, 0.0, 0.5]) / np.sqrt(1.25)
    rotation = np.stack([axis, [0.0, 1.0, 0.0], np.cross(axis, [0.0, 1.0, 0.0])])
    frame = Product("frame", attrs={"rotation": rotation.tolist(), "origin_mm": [0.0, 0.0, 500.0]})
    after = tilted + 0.02 * (tilted @ axis)[..., None] * axis
    result = Deformation().run(points=points(after), points_first=first_points(tilted), frame=frame)
    assert np.abs(result["exx"] - 0.02).max() < 1e-9
    assert max(np.abs(result[name]).max() for name in ("V", "W", "eyy", "gxy")) < 1e-9
    assert np.abs(result["xyz_reference"][..., 2]).max() < 1e-9
    plain = Deformation().run(points=points(after), points_first=first_points(tilted))
    assert np.allclose(result["U"], np.hypot(plain["U"], plain["W"]) * np.sign(plain["U"]), atol=1e-9)


def test_one_camera():
    gradient = np.array([[1.1, 0.2], [-0.1, 0.9]])
    first = correlation(grid_px(), np.eye(2))
    result = Deformation().run(points=correlation(grid_px() @ gradient.T, gradient), points_first=first)
    assert np.abs(result["gradient"] - gradient).max() < 1e-9
    assert np.allclose(result["U"], (grid_px() @ gradient.T - grid_px())[..., 0])
    assert result.variables["U"].units == result.attrs["unit"] == "px"
    assert result.attrs["vsg_mm"] is None
    expected = np.sqrt(1e-4 + 1e-4 * (gradient @ gradient.T).diagonal())
    assert np.allclose(result["sigma_U"], expected[0])
    assert np.allclose(result["sigma_V"], expected[1])
    assert not result["W"].any()


def test_missing_points_say_why():
    after = deformed(STRETCH)
    after[5, 5] = np.nan
    after[20:, 10:] = np.nan
    after[30, 20] = FLAT[30, 20]
    result = total(after)
    assert result["status"][5, 5] == Status.NO_MATCH
    assert result["status"][30, 20] == Status.TOO_FEW_NEIGHBOURS
    valid = result["status"] == Status.VALID
    for name in ("U", "sigma_U", "exx", "sigma_exx", "e1", "xyz"):
        assert np.array_equal(np.isfinite(result[name].reshape(*SHAPE, -1)).all(axis=-1), valid)
    assert result.attrs["summary"]["valid_share"] == pytest.approx(valid.mean())


def test_a_step_without_points_is_empty_not_an_error():
    result = total(np.full_like(FLAT, np.nan), rigid=True)
    assert np.isnan(result["exx"]).all()
    assert result.attrs["summary"] == {"valid_share": 0.0}


def test_a_window_too_small_is_refused():
    sparse = np.full_like(FLAT, np.nan)
    sparse[::4, ::4] = FLAT[::4, ::4]
    with pytest.raises(StageError, match="widen the window"):
        total(sparse, window=21)


@pytest.mark.slow
def test_one_sigma_covers_68_percent_of_displacement_and_strain():
    rng, scores = np.random.default_rng(8), {name: [] for name in ("U", "V", "W", "exx", "eyy", "gxy", "e1")}
    before, after = sheet((0.3, -0.2)), deformed(STRETCH, sheet((0.3, -0.2)), (0.05, -0.1, 0.1), (1, 2, 3))
    truth = total(after, before)
    for _ in range(30):
        common = template_errors(rng)
        noisy = Deformation().run(points=points(after, rng, common), points_first=first_points(before, rng, common))
        for name, found in scores.items():
            found.append((noisy[name] - truth[name]) / noisy[f"sigma_{name}"])
    for found in scores.values():
        assert (np.abs(found) < 1).mean() == pytest.approx(0.683, abs=0.03)
        assert (np.abs(found) < 2).mean() == pytest.approx(0.954, abs=0.02)


def test_the_first_step_takes_the_noise_measured_at_later_steps():
    """Half of the noise at both steps halves σ."""
    first, step = first_points(FLAT), points(1.1 * FLAT)
    quiet = {name: step.variables[name]._replace(values=0.25 * step[name]) for name in ("covariance", "template")}
    loud_first = Product("points", first.variables, {**first.attrs, "noise_grey": 2.0})
    loud = Product("points", step.variables, {**step.attrs, "noise_grey": 2.0})
    later = Product("points", {**step.variables, **quiet}, {**step.attrs, "noise_grey": 1.0})
    one, two = (Deformation().run(points=part, points_first=loud_first) for part in (loud, later))
    for name in ("sigma_U", "sigma_W", "sigma_exx", "sigma_gxy"):
        np.testing.assert_allclose(two[name], 0.5 * one[name], rtol=1e-5)


def uncertain(covariance):
    return Product("rig", attrs={"rig": rig_to_json(RIG), "covariance": np.asarray(covariance).tolist()})


def through_another_rig(step, after, before, **parameters):
    """The total of the same photographs, with the rig's numbers wrong by a step."""
    rig = rig_after_step(RIG, step)
    states = [points(triangulate(rig, part["xy"], part["xy_right"]).xyz) for part in (after, before)]
    return Deformation(**parameters).run(points=states[0], points_first=states[1])


def test_the_share_of_the_calibration():
    """A baseline known to 0.1 % makes all lengths in space, and so all displacements, wrong by 0.1 %, and no strain."""
    shift = np.concatenate([np.zeros(21), 1e-3 * RIG.translation])
    result = Deformation().run(
        points=points(deformed(STRETCH, shift=(1.0, 2.0, 3.0))),
        points_first=first_points(FLAT),
        rig=uncertain(np.outer(shift, shift)),
    )
    assert np.allclose(result["calibration_xyz"], 1e-3 * np.abs(result["xyz"]), atol=1e-6)
    assert result.variables["calibration_xyz"].units == "mm"
    for name in "UVW":
        assert np.allclose(result[f"calibration_{name}"], 1e-3 * np.abs(result[name]), atol=1e-7)
    for name in ("exx", "eyy", "gxy", "e1", "e2", "von_mises", "area_change"):
        assert np.abs(result[f"calibration_{name}"]).max() < 2e-6


def test_the_calibration_share_is_what_another_rig_would_give():
    step = np.zeros(24)
    step[0] = 10.0
    before, after = points(FLAT), points(deformed(STRETCH, turn=(0, 0.1, 0), shift=(1.0, 2.0, 3.0)))
    shares = Deformation().run(points=after, points_first=before, rig=uncertain(np.outer(step, step)))
    moved = through_another_rig(step, after, before)
    for name in ("U", "V", "W", "exx", "eyy", "gxy", "e1", "e2", "von_mises", "area_change", "xyz"):
        change = np.abs(moved[name] - shares[name])
        deviation = np.abs(shares[f"calibration_{name}"] - change)
        assert np.median(deviation) < 0.01 * change.max()
        assert deviation.max() < 0.1 * change.max()


@pytest.mark.slow
@pytest.mark.parametrize("rigid", [False, True])
def test_the_calibration_share_is_the_scatter_of_rigs_drawn_from_its_covariance(rigid):
    """A Monte Carlo over all 24 numbers; the points' errors being one error, only the draws count."""
    rng, draws = np.random.default_rng(3), 120
    scale = np.array([*[2.0] * 4, *[1e-3, 1e-2, 1e-4, 1e-4, 0.0]] * 2 + [2e-4] * 3 + [0.05] * 3)
    root = scale[:, None] * rng.normal(size=(24, 30)) / np.sqrt(30)
    motion = {"turn": (0.05, 0.1, -0.1), "shift": (4.0, 2.0, -6.0)}
    before, after = points(FLAT), points(deformed(np.diag([0.95, 1.2, 1.0]), **motion))
    result = Deformation(rigid=rigid).run(points=after, points_first=before, rig=uncertain(root @ root.T))
    steps = rng.normal(size=(draws, 30)) @ root.T
    moved = [through_another_rig(step, after, before, rigid=rigid) for step in steps]
    for name in ("xyz", "U", "V", "W", "exx", "eyy", "gxy", "e1", "e2", "von_mises", "area_change"):
        scatter = np.sqrt(np.mean([(part[name] - result[name]) ** 2 for part in moved], axis=0))
        ratio = np.sqrt((result[f"calibration_{name}"] ** 2).mean() / (scatter**2).mean())
        assert ratio == pytest.approx(1.0, abs=3.5 / np.sqrt(2 * draws)), name


def test_a_motion_that_is_taken_out_takes_the_calibrations_share_along():
    """A baseline known to 0.1 %: of a motion by 40 mm nothing is left, nor of its share of 40 µm."""
    shift = np.concatenate([np.zeros(21), 1e-3 * RIG.translation])
    after, rig = points(deformed(np.eye(3), turn=(0, 0, 0.1), shift=(40.0, 0, 0))), uncertain(np.outer(shift, shift))
    kept, taken = (Deformation(rigid=r).run(points=after, points_first=points(FLAT), rig=rig) for r in (False, True))
    assert np.median(kept["calibration_U"]) == pytest.approx(0.04, rel=0.05)
    assert max(np.abs(taken[f"calibration_{name}"]).max() for name in "UVW") < 1e-6


def test_variables_have_units_and_names():
    result = total(deformed(STRETCH))
    assert result.variables["sigma_W"].units == "mm"
    assert result.variables["angle"].units == "deg"
    assert result.variables["sigma_exx"].units == "1"
    assert result.variables["sigma_exx"].long_name.startswith("σ of the engineering strain")
    assert result["covariance"].shape == (*SHAPE, 21)
    assert np.array_equal(result["xy_reference"], grid_px())
    assert isinstance(result.variables["way"], Variable)


def test_maps_of_any_field_with_its_gauge():
    result = total(deformed(STRETCH), measure="hencky")
    drawn = ran(Maps(quantities=("U", "eyy", "von_mises", "sigma_eyy", "sigma_U")), total=[result]).attrs["quantities"]
    assert drawn["U"]["title"] == "displacement U"
    assert drawn["eyy"]["title"] == "Hencky strain (material directions) εyy, VSG 63 px = 3.15 mm"
    assert drawn["sigma_eyy"]["title"].startswith("σ of the Hencky strain (material directions) εyy, VSG")
    assert drawn["sigma_U"]["unit"] == "mm"
    assert drawn["eyy"]["range"] == pytest.approx([np.log(2.3)] * 2, abs=1e-5)
    with pytest.raises(StageError, match=r"no calibration_U .* U, V, W"):
        ran(Maps(quantities=("calibration_U",)), total=[result])


def test_what_maps_reports_and_exports_read_is_at_hand():
    """However quickly it could be made again."""
    assert is_kept(Deformation(), arrays=60, nbytes=10**8, seconds=0.0, depth=1)
    assert not is_kept(Deformation(keep="never"), arrays=60, nbytes=10**8, seconds=0.0, depth=1)


def test_uncertainty_combines_noise_and_bias():
    """u² = σ² + bias² for all quantities; a wave that degree 1 cannot follow has a bias, a homogeneous field none."""
    rng, wave = np.random.default_rng(4), FLAT.copy()
    wave[..., 0] += 0.01 * np.sin(2.0 * np.pi * FLAT[..., 0] / 5.0)
    step, first = points(wave, rng), first_points(FLAT, rng)
    result = Deformation(degree=1).run(points=step, points_first=first)
    for name in ("exx", "gxy", "e1", "von_mises", "U"):
        bias = 0.0 if name == "U" else result[f"bias_{name}"]
        np.testing.assert_allclose(result[f"u_{name}"], np.hypot(result[f"sigma_{name}"], bias), rtol=1e-6)
    exact = Deformation(degree=1).run(points=points(wave), points_first=first_points(FLAT))
    error = exact["exx"] - 0.01 * 2.0 * np.pi / 5.0 * np.cos(2.0 * np.pi * FLAT[..., 0] / 5.0)
    inside = (slice(5, -5), slice(5, -5))
    stated = np.sqrt(np.mean(result["bias_exx"][inside] ** 2))
    assert stated == pytest.approx(np.sqrt(np.mean(error[inside] ** 2)), rel=0.3)
    assert result.variables["u_exx"].long_name.startswith("uncertainty u of the engineering strain")
    assert result.variables["bias_exx"].values.dtype == np.float32
    even = Deformation(degree=1).run(points=points(1.01 * FLAT, rng), points_first=first)
    assert np.median(even["bias_exx"]) == 0.0
    assert "degree" not in even
    assert "vsg" not in even


def test_the_degree_is_stated():
    rng, wave = np.random.default_rng(4), FLAT.copy()
    wave[..., 0] += 0.01 * np.sin(2.0 * np.pi * FLAT[..., 0] / 5.0)
    result = Deformation().run(points=points(wave, rng), points_first=first_points(FLAT, rng))
    assert result["degree"].dtype == np.uint8
    found, counts = np.unique(result["degree"], return_counts=True)
    assert result.attrs["degree_shares"] == {
        str(k): pytest.approx(n / counts.sum()) for k, n in zip(found, counts, strict=True)
    }
    assert result.attrs["degree"] == found[counts.argmax()] > 1
    sides = {
        (int(points) - 1) * STEP_SIZE + SUBSET_SIZE: share for points, share in result.attrs["window_shares"].items()
    }
    assert sides == {
        side: pytest.approx((result["vsg"] == side).mean()) for side in np.unique(result["vsg"][result["degree"] > 0])
    }
    assert max(sides) == result.attrs["vsg_px"]
    error = np.abs(result["exx"] - 0.01 * 2.0 * np.pi / 5.0 * np.cos(2.0 * np.pi * FLAT[..., 0] / 5.0))
    assert (error < 2.0 * result["u_exx"]).mean() == pytest.approx(0.954, abs=0.04)


def test_the_bias_of_places_is_that_of_displacements():
    """Turned with the frame in space; in the plane of one photograph as it is."""
    moved = np.array([[0.01, 0.0], [0.0, 0.02], [0.0, 0.0]])
    step = points(1.01 * FLAT)
    biased = Product("points", {**step.variables, "bias": _spread(moved)}, step.attrs)
    axis = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    frame = Product("frame", attrs={"rotation": axis.tolist(), "origin_mm": [0.0, 0.0, 0.0]})
    result = Deformation().run(points=biased, points_first=first_points(FLAT), frame=frame)
    for name, expected in {"U": 0.02, "V": 0.01, "W": 0.0}.items():
        np.testing.assert_allclose(result[f"bias_{name}"], expected, atol=1e-9)
        np.testing.assert_allclose(result[f"u_{name}"], np.hypot(result[f"sigma_{name}"], expected), rtol=1e-6)
    unknown = {**biased.variables, "bias": _spread(np.full((3, 2), np.nan))}
    alone = Deformation().run(points=Product("points", unknown, step.attrs), points_first=first_points(FLAT))
    np.testing.assert_array_equal(alone["u_U"], alone["sigma_U"])
    flat = correlation(grid_px(), np.eye(2))
    flat = Product("correlation", {**flat.variables, "bias": _spread(np.array([0.1, 0.3]))}, flat.attrs)
    plane = Deformation().run(points=flat, points_first=correlation(grid_px(), np.eye(2)))
    np.testing.assert_allclose([plane["bias_U"][3, 4], plane["bias_V"][3, 4], plane["bias_W"][3, 4]], [0.1, 0.3, 0.0])


def test_scatter_beyond_sigma_is_a_bias_of_displacements():
    """σ stays that of the photographs' noise; u is the scatter."""
    rng = np.random.default_rng(6)
    even = Deformation().run(points=points(FLAT, rng), points_first=first_points(FLAT, rng))
    rough = np.zeros_like(FLAT)
    variance = 9.0 * np.median(even["sigma_V"]) ** 2
    rough[..., 1] = point_errors(rng, FLAT.shape[:2], variance * np.eye(2), SUBSET_SIZE, STEP_SIZE)[..., 0]
    step = points(FLAT + rough, rng)
    step = Product("points", {**step.variables, "bias": _spread(np.zeros((3, 2)))}, step.attrs)
    result = Deformation().run(points=step, points_first=first_points(FLAT, rng))
    np.testing.assert_allclose(result["sigma_V"], even["sigma_V"], rtol=1e-6)
    np.testing.assert_array_equal(result["bias_U"], np.zeros_like(result["bias_U"]))
    assert np.median(result["u_V"]) == pytest.approx(np.std(result["V"]), rel=0.25)
    assert np.median(result["u_V"]) > 2.5 * np.median(result["sigma_V"])


def _spread(values):
    """One array at every point."""
    dims = ("row", "col", "component", "image_component")[: 2 + values.ndim]
    return Variable(dims, np.broadcast_to(values, (*SHAPE, *values.shape)))
