"""Sheets in equilibrium, and their photographs, against theory."""

import json

import cv2
import numpy as np
import pytest

from dicflow.core.cameras.camera import project
from dicflow.core.material.membrane import sheet_stress
from dicflow.core.material.models import MODELS
from dicflow.core.material.response import stress_in_mode
from dicflow.core.synthetic.deformation import Deformation
from dicflow.core.synthetic.sheet import displaced, place_of, sheet_between, trace_sheet
from dicflow.core.synthetic.stand import verged_stand
from dicflow.synth.equilibrium import equilibrium
from dicflow.synth.sheets import CONSTANTS, GRAVITY, SHAPES, Rubber, loads_of, solved, write_sheets

pytestmark = pytest.mark.slow  # of sheets that are computed and rendered

MODEL, C = MODELS["mooney_rivlin"], np.array(CONSTANTS["mooney_rivlin"])


@pytest.fixture(scope="module")
def wide():
    """60 mm wide and 20 mm long, at a small and a large load."""
    lines = np.linspace(0.0, 60.0, 37), np.linspace(0.0, 20.0, 13)
    return equilibrium(MODEL, C, lines, 60.0 * np.array([0.2, 0.5]))


@pytest.fixture(scope="module")
def sheet(wide):
    stand = verged_stand((288, 384), 150.0)
    pose = Deformation(20.0, 60.0, rotation=stand.rotation, translation=stand.translation)
    return sheet_between((60.0, 20.0), wide.moved[1], pose), stand.rig.left


@pytest.mark.parametrize("share", [0.25, 0.5, 0.75])
def test_every_cut_carries_the_load(sheet, share):
    """The mean nominal stress along the load across a section of the spline through the nodes is the load."""
    x = np.linspace(-30.0, 30.0, 601)
    _, gradient = displaced(sheet[0], np.stack([x, np.full_like(x, 20.0 * share)], axis=-1))
    stress = sheet_stress(MODEL, C, gradient)[:, 1, 1]
    assert np.trapezoid(stress, x) == pytest.approx(30.0, rel=2e-3)


def test_the_sides_are_free_and_the_middle_is_nearly_in_pure_shear(sheet, wide):
    _, gradient = displaced(sheet[0], np.array([[-30.0, 10.0], [30.0, 10.0], [0.0, 10.0]]))
    stress = sheet_stress(MODEL, C, gradient)
    assert np.abs(stress[:2, :, 0]).max() < 0.01 * stress[2, 1, 1]
    stretch = gradient[2, 1, 1]
    assert gradient[2, 0, 0] == pytest.approx(1.0, abs=0.06)
    assert stress[2, 1, 1] == pytest.approx(stress_in_mode(MODEL, C, "planar", np.array([stretch]))[0], rel=0.05)
    np.testing.assert_allclose(wide.moved[:, -1, :, 0], 0.0)
    assert np.ptp(wide.moved[1, -1, :, 1]) == 0.0


def test_a_narrow_strip_is_nearly_uniaxial():
    lines = np.linspace(0.0, 20.0, 11), np.linspace(0.0, 60.0, 31)
    found = equilibrium(MODEL, C, lines, np.array([20.0 * 0.5]))
    middle = found.gradients[0][np.abs(found.places[:, 1] - 30.0) < 2.0].mean(axis=0)
    assert stress_in_mode(MODEL, C, "uniaxial", middle[1:, 1])[0] == pytest.approx(0.5, rel=1e-3)
    assert middle[0, 0] == pytest.approx(middle[1, 1] ** -0.5, rel=1e-3)


def test_no_equilibrium_is_said():
    with pytest.raises(ValueError, match="no equilibrium was found at 1e\\+06 N/mm"):
        equilibrium(MODEL, np.array([1e-3, 0.0]), (np.linspace(0, 20, 3), np.linspace(0, 20, 3)), np.array([1e6]))


def test_pixels_show_the_material_that_is_there(sheet):
    state, camera = sheet
    points, slopes = trace_sheet(camera, state, (120, 200, 170, 240))
    seen = project(camera, place_of(state, points))
    pixels = np.stack(np.meshgrid(np.arange(120, 170), np.arange(200, 240)), axis=-1)
    np.testing.assert_allclose(seen, pixels, atol=1e-6)
    beside = project(camera, place_of(state, points + 1e-3 * slopes[..., 0]))
    np.testing.assert_allclose(beside - pixels, np.broadcast_to([1e-3, 0.0], seen.shape), atol=1e-6)


def test_unloading_follows_the_damage():
    """A load of unloading stretches as far as that of loading of which the damage leaves it; the last step rests."""
    rubber = Rubber(up=3, down=3, damage=0.3)
    strip = SHAPES["strip"]
    grams, shown = loads_of(rubber, strip)
    assert len(shown) == 7
    assert shown[-1] == grams[-1] == 0.0
    assert np.abs(grams - shown).max() < 0.5
    found = solved(rubber, strip, elements=6)
    force = grams * 1e-3 * GRAVITY / rubber.true_thickness
    share = found.forces[4:] / force[3]
    np.testing.assert_allclose(force[4:], force[3] * share * (1 - 0.3 * np.tanh((1 - share) / 0.5)), rtol=1e-5)
    assert 0.0 < found.moved[5, -1, 0, 1] < found.moved[4, -1, 0, 1] < found.moved[3, -1, 0, 1]
    np.testing.assert_allclose(found.moved[-1], 0.0, atol=1e-9)


def test_a_folder_of_sheets(tmp_path):
    rubber = Rubber("neo_hooke", CONSTANTS["neo_hooke"], up=1)
    write_sheets(tmp_path, rubber, shapes=("wide",), scale=0.15, boards=2)
    truth = json.loads((tmp_path / "truth" / "rubber.json").read_text())
    assert truth["true_thickness"] == pytest.approx(0.21, abs=0.02)
    assert (tmp_path / "wide" / "weights.csv").read_text().splitlines()[:2] == ["step,load_g", "step_00,0.0"]
    assert len(list((tmp_path / "boards").rglob("*.png"))) == 4
    first, last = (cv2.imread(str(tmp_path / f"wide/photos/left/step_0{k}.png"), 0) for k in (0, 1))
    rows = [np.flatnonzero((image > 120).mean(axis=1) > 0.1) for image in (first, last)]
    moved = np.load(tmp_path / "wide" / "truth.npz")["moved"][1, -1, 0, 1]
    assert np.ptp(rows[1]) - np.ptp(rows[0]) == pytest.approx(moved * 288 / 150, abs=3)
