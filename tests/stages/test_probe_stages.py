"""Frames, probes and the noise floor on measured points of known fields."""

import json

import numpy as np
import pytest
from looking import ran
from measured_points import RIG, SHAPE, STEP_SIZE, first_points, grid_px, points, sheet, template_errors
from pydantic import ValidationError

from dicflow.core.cameras.camera import rotation_matrix
from dicflow.core.cameras.rig_parameters import error_modes, rig_after_step
from dicflow.core.cameras.triangulate import triangulate
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.channels import Channel, Channels
from dicflow.kinds.probes import ProbeTable
from dicflow.kinds.rig import rig_to_json
from dicflow.stages.deformation import Deformation
from dicflow.stages.frame import Frame
from dicflow.stages.noise_floor import NoiseFloor
from dicflow.stages.probes import Probes

FLAT = sheet()
CENTRE = FLAT.mean(axis=(0, 1))
STRETCH = np.diag([2.3**-0.5, 2.3, 1.0])
PLACES = {
    "points": {"P": (350.3, 300.2)},
    "lines": {"L": ((320.0, 250.0), (440.0, 250.0))},
    "areas": {"A": ((330.0, 230.0), (400.0, 230.0), (400.0, 300.0), (330.0, 300.0))},
    "extensometers": {"E": ((380.0, 205.0), (380.0, 425.0))},
}


class Steps(tuple):
    """Products of all steps, as a store gives them."""

    steps = ("one", "two")


def moved(gradient, turn=(0, 0, 0), shift=(0, 0, 0)):
    return ((FLAT - CENTRE) @ np.asarray(gradient).T) @ rotation_matrix(turn).T + CENTRE + shift


def total(after, rng=None, common=None, **parameters):
    first = first_points(FLAT, rng, common)
    return Deformation(**{"window": 50, **parameters}).run(points=points(after, rng, common), points_first=first)


@pytest.fixture(scope="module")
def perfect():
    states = [moved(np.eye(3), (0, 0, 0.1), (1, 2, 3)), moved(STRETCH, (0.1, -0.2, 0.1), (5, 6, 7))]
    return Steps(total(state) for state in states)


def test_perfect_readings(perfect):
    result = ran(Probes(**PLACES), total=perfect)
    assert result.kind == "probes"
    assert result["strain"] == pytest.approx(np.array([[0.0, 0.0, 1.3]]), abs=1e-9)
    length = 220 * 0.05
    assert result["length"] == pytest.approx(length * np.array([[1.0, 1.0, 2.3]]))
    assert result["elongation"] == pytest.approx(length * np.array([[0.0, 0.0, 1.3]]), abs=1e-9)
    assert result["eyy"] == pytest.approx(np.array([[0.0, 0.0, 1.3]] * 3), abs=1e-9)
    there = np.array([(350.3 - 500) * 0.05, (300.2 - 400) * 0.05, 500.0]) - CENTRE
    expected = rotation_matrix((0.1, -0.2, 0.1)) @ STRETCH @ there - there + [5, 6, 7]
    assert [result[name][0, 2] for name in "UVW"] == pytest.approx(expected)
    assert result["profile_eyy"].shape == (1, 2, 101)
    assert result["profile_eyy"][0, 1] == pytest.approx(1.3)
    assert result["profile_U"][0, :].mean(axis=-1) == pytest.approx(result["U"][1, 1:])


def test_channels_stand_beside_the_readings_of_each_step(perfect):
    """1.3 of strain in the last 4 s; the parabola through 0, 0 and 1.3 at 0, 2 and 6 s rises by 0.325 / 3 at 2 s."""
    force = Channel(np.array([0.5, np.nan, 2.0]), "N", "force")
    time = Channel(np.array([0.0, 2.0, 6.0]), "s", "time")
    channels = Channels.write({"force": force, "time": time}, ["first", "one", "two"], "force")
    result = ran(Probes(**PLACES), total=perfect, channels=channels)
    plain = ran(Probes(**PLACES), total=perfect)
    assert [row["force_N"] for row in result.attrs["rows"] if row["probe"] == "P"] == [0.5, None, 2.0]
    np.testing.assert_array_equal(result["channel_time_s"], [0.0, 2.0, 6.0])
    assert result["strain_rate"][0] == pytest.approx([0.0, 1.3 / 4 / 3, 1.3 / 4], abs=1e-9)
    last = result.attrs["rows"][-1]
    assert last["strain_rate_per_s"] == pytest.approx(0.325)
    assert {name: last[name] for name in plain.attrs["rows"][-1]} == plain.attrs["rows"][-1]
    json.dumps(result.attrs, allow_nan=False)


def test_rows_are_a_table(perfect):
    result = ran(Probes(**PLACES), total=perfect)
    assert [(row["probe"], row["kind"], row["step"]) for row in result.attrs["rows"][:3]] == [
        ("P", "point", "reference"),
        ("P", "point", "one"),
        ("P", "point", "two"),
    ]
    last = result.attrs["rows"][-1]
    assert last["strain"] == pytest.approx(1.3)
    assert set(last) == {
        *("probe", "kind", "step", "length_mm", "elongation_mm", "strain"),
        *(f"{part}_{name}" for part in ("sigma", "bias", "u") for name in ("length_mm", "elongation_mm", "strain")),
    }
    assert result.attrs["summary"]["E_strain"] == pytest.approx(1.3)
    assert result.attrs["vsg_px"] == perfect[0].attrs["vsg_px"]
    json.dumps(result.attrs, allow_nan=False)


def test_places_in_millimetres(perfect):
    in_mm = {"E": tuple(tuple((np.array(end) - [500, 400]) * 0.05) for end in PLACES["extensometers"]["E"])}
    result = ran(Probes(extensometers=in_mm, unit="mm"), total=perfect)
    assert result["strain"] == pytest.approx(np.array([[0.0, 0.0, 1.3]]), abs=1e-9)


def test_a_rectangle_is_an_area(perfect):
    assert Probes(areas={"A": [330, 230, 400, 300]}) == Probes(areas=PLACES["areas"])


@pytest.mark.slow
def test_sigma_covers_the_errors(perfect):
    probe = Probes(**{**PLACES, "lines": {}, "areas": {**PLACES["areas"], "thin": (330, 298, 400, 305)}})
    rng, scores = np.random.default_rng(4), {}
    truth = ran(probe, total=perfect[1:])
    for _ in range(60):
        common = template_errors(rng)
        after = moved(STRETCH, (0.1, -0.2, 0.1), (5, 6, 7))
        noisy = ran(probe, total=(total(after, rng, common),))
        for name in ("U", "W", "exx", "eyy", "gxy", "length", "strain"):
            error = (noisy[name] - truth[name])[:, 1] / noisy[f"sigma_{name}"][:, 1]
            scores.setdefault(name, []).append(error)
    for name, found in scores.items():
        spread = np.std(found, axis=0)
        assert np.all(np.abs(spread - 1) < 4 / np.sqrt(120)), name


@pytest.mark.parametrize("rigid", [False, True])
def test_the_calibration_share_is_what_rigs_of_its_modes_read(rigid):
    """The root of the sum of squares of what rigs that are wrong by one independent error each read otherwise."""
    scale = np.array([*[2.0] * 4, *[1e-2, 1e-1, 1e-3, 1e-3, 0.0]] * 2 + [2e-4] * 3 + [0.05] * 3)
    root = scale[:, None] * np.random.default_rng(7).normal(size=(24, 4))
    before, after = points(FLAT), points(moved(np.diag([0.95, 1.3, 1.0]), (0.1, -0.2, 0.1), (5, 6, 7)))
    probes = Probes(**{**PLACES, "areas": {**PLACES["areas"], "whole": (300.0, 200.0, 475.0, 431.0)}})

    def read(rig, given=None):
        states = []
        for part in (after, before):
            xyz = points(triangulate(rig, part["xy"], part["xy_right"]).xyz)
            states.append(Product("points", {**xyz.variables, "xy": part.variables["xy"]}, xyz.attrs))
        return ran(probes, total=(Deformation(rigid=rigid).run(points=states[0], points_first=states[1]),), rig=given)

    covariance = root @ root.T
    found = read(RIG, Product("rig", attrs={"rig": rig_to_json(RIG), "covariance": covariance.tolist()}))
    others = [read(rig_after_step(RIG, mode)) for mode in error_modes(covariance).T]
    for name in ("U", "V", "W", "exx", "eyy", "gxy", "length", "elongation", "strain"):
        expected = np.sqrt(np.sum([(other[name] - found[name]) ** 2 for other in others], axis=0))
        np.testing.assert_allclose(found[f"calibration_{name}"], expected, rtol=0.05, atol=0.02 * expected.max())
    row = found.attrs["rows"][-1]
    assert row["calibration_strain"] == pytest.approx(found["calibration_strain"][0, -1])
    assert row["calibration_length_mm"] == pytest.approx(found["calibration_length"][0, -1])
    json.dumps(found.attrs, allow_nan=False)


def test_without_the_calibrations_error_nothing_is_said_of_it(perfect):
    rig = Product("rig", attrs={"rig": rig_to_json(RIG)})
    assert not [name for name in ran(Probes(**PLACES), total=perfect, rig=rig).variables if "calibration" in name]


def test_a_lost_probe_has_no_value_there(perfect):
    lost = points(moved(STRETCH))["xyz"].copy()
    lost[:, 10:] = np.nan
    result = ran(Probes(**PLACES), total=Steps((perfect[0], total(lost))))
    assert np.isfinite(result["strain"][0, :2]).all()
    assert np.isnan(result["strain"][0, 2])
    assert result.attrs["rows"][-1]["strain"] is None
    assert result.attrs["summary"]["E_strain"] == pytest.approx(0.0, abs=1e-9)
    assert np.isfinite(result["U"][2]).all()


def test_probes_that_all_lie_beside_the_specimen_are_refused(perfect):
    places = r"move it into the region: points are measured at x 300 … 475, y 200 … 431 px of the first step"
    with pytest.raises(StageError, match=rf"probe 'Q' lies where no step has a measured point; {places}"):
        ran(Probes(points={"Q": (5.0, 5.0)}), total=perfect)


def test_a_probe_beside_the_specimen_leaves_the_others(perfect):
    beside = {"points": {**PLACES["points"], "Q": (5.0, 5.0)}, "extensometers": {**PLACES["extensometers"]}}
    beside["extensometers"] |= {"F": ((5.0, 5.0), (380.0, 425.0))}
    beside["areas"] = {**PLACES["areas"], "B": ((5.0, 5.0), (9.0, 5.0), (9.0, 9.0))}
    result = ran(Probes(**{**PLACES, **beside}), total=perfect)
    alone = ran(Probes(**PLACES), total=perfect)
    for name in ("strain", "u_strain", "U", "eyy"):
        kept = [0] if "strain" in name else [0, 2, 3]
        np.testing.assert_array_equal(result[name][kept], alone[name])
        assert np.isnan(np.delete(result[name], kept, axis=0)).all()
    (warning,) = result.warnings
    assert warning.startswith("each of the probes 'Q', 'B', 'F' lies where no step has a measured point")
    assert set(result.attrs["unmeasured"]) == {"Q", "B", "F"}
    assert "F_strain" not in result.attrs["summary"]
    with pytest.raises(StageError, match="probe 'F' lies where no step"):
        ProbeTable.read(result).of_extensometer("F", "strain")
    json.dumps(result.attrs, allow_nan=False)


def test_what_cannot_be_probed_is_refused_early():
    with pytest.raises(ValidationError, match="at least one of"):
        Probes()
    with pytest.raises(ValidationError, match="A for several"):
        Probes(points={"A": (1, 2)}, areas={"A": (0, 0, 5, 5)})


def test_the_plane_of_the_specimen():
    tilted = sheet((0.3, -0.2))
    frame = Frame().run(points=first_points(tilted))
    result = Deformation().run(points=points(tilted), points_first=first_points(tilted), frame=frame)
    assert np.abs(result["xyz_reference"][..., 2]).max() < 1e-9
    assert frame.attrs["summary"]["flatness_mm"] < 1e-9
    json.dumps(frame.attrs, allow_nan=False)


def test_three_points_in_pixels_and_millimetres():
    first = first_points(FLAT)
    places = ((330.0, 410.0), (330.0, 230.0), (400.0, 400.0))
    frame = Frame(method="three_points", places=places).run(points=first)
    assert np.allclose(frame.attrs["rotation"], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-9)
    assert np.allclose(frame.attrs["origin_mm"], [-8.5, 0.5, 500.0])
    in_mm = tuple((*((np.array(place) - [500, 400]) * 0.05), 500.0) for place in places)
    other = Frame(method="three_points", places=in_mm).run(points=first)
    assert np.allclose(other.attrs["rotation"], frame.attrs["rotation"])
    with pytest.raises(StageError, match="no measured point at"):
        Frame(method="three_points", places=((0, 0), (9, 0), (0, 9))).run(points=first)


def test_given_axes_and_the_camera():
    frame = Frame(method="axes", x=(1, 0, 0), y=(0, -1, 0), origin=(0, 0, 500)).run(points=first_points(FLAT))
    assert np.allclose(frame.attrs["rotation"], np.diag([1, -1, -1]))
    camera = Frame(method="camera").run(points=first_points(FLAT))
    assert np.array_equal(camera.attrs["rotation"], np.eye(3))
    with pytest.raises(ValidationError, match=r"axes needs x, y, origin .*found x"):
        Frame(method="axes", x=(1, 0, 0))


def test_a_frame_needs_points():
    empty = Product("points", first_points(np.full_like(FLAT, np.nan)).variables, first_points(FLAT).attrs)
    with pytest.raises(StageError, match="three points, found 0"):
        Frame().run(points=empty)


def test_grid_is_what_the_places_refer_to(perfect):
    assert np.array_equal(perfect[0]["xy_reference"], grid_px())
    assert SHAPE[0] * STEP_SIZE > 220


def test_noise_floor_of_a_rigid_motion():
    """Measured σ is the predicted one, within the scatter of 884 points of overlapping subsets and two steps."""
    rng, motions = np.random.default_rng(6), [((0, 0, 0), (0, 0, 0)), ((0.05, -0.1, 0.1), (1, 2, 3))]
    common = template_errors(rng)
    first = first_points(FLAT, rng, common)
    totals = Steps(
        Deformation().run(points=points(moved(np.eye(3), *motion), rng, common), points_first=first)
        for motion in motions
    )
    result = NoiseFloor().run(total=totals)
    for quantity in ("U_mm", "V_mm", "W_mm", "exx", "eyy", "gxy", "area_change"):
        summary = result.attrs["summary"]
        assert summary[f"sigma_{quantity}"] == pytest.approx(summary[f"predicted_sigma_{quantity}"], rel=0.25)
        assert summary[f"max_bias_{quantity}"] < 0.5 * summary[f"sigma_{quantity}"]
    assert result["sigma"].shape == (9, 2)
    assert len(result.attrs["rows"]) == 18
    apart = {row["quantity"]: row["bias"] / row["sigma"] for row in result.attrs["rows"]}
    assert 0.5 < apart["e1"] < 1.5
    assert -1.5 < apart["e2"] < -0.5
    assert result.attrs["rows"][0]["points"] == SHAPE[0] * SHAPE[1]
    json.dumps(result.attrs, allow_nan=False)
    kept = NoiseFloor(still=("two",), rigid=False).run(total=totals)
    assert kept.attrs["steps"] == ["two"]
    assert kept["bias"][:3, 0] == pytest.approx([1, 2, 3], abs=0.1)
    assert kept["sigma"][0, 0] > 20 * result["sigma"][0, 1]


def test_perfect_noise_floor(perfect):
    result = NoiseFloor(still=("one",)).run(total=perfect)
    assert np.abs(result["bias"]).max() < 1e-9
    assert np.abs(result["sigma"]).max() < 1e-9
    assert result["predicted_sigma"].min() > 1e-4


def test_noise_floor_of_steps_that_do_not_exist(perfect):
    with pytest.raises(StageError, match=r"step three .* one, two"):
        NoiseFloor(still=("three",)).run(total=perfect)
