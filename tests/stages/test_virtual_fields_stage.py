"""Stages sheet and virtual_fields on fields in equilibrium, solved by finite elements."""

from dataclasses import replace

import numpy as np
import pytest

from dicflow.core.material.models import MODELS
from dicflow.core.photographs.polygon import Polygon
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.kinds.channels import Channel, Channels
from dicflow.kinds.material import Material
from dicflow.kinds.region import Region
from dicflow.kinds.sheet import SheetFields
from dicflow.kinds.total import Total, TotalFacts
from dicflow.stages.sheet import Sheet
from dicflow.stages.virtual_fields import VirtualFields
from dicflow.synth.equilibrium import equilibrium

TRUTH, SIDE, CELLS, STEP_PX = np.array([0.18, 0.03]), 60.0, 20, 7
STRESSES = np.array([0.1, 0.2, 0.3])
THICKNESS, SIGMA = 0.21, 1e-3
SECTION = {"thickness": THICKNESS, "u_thickness": 0.005}
PX = STEP_PX * CELLS / SIDE
"""Pixels per millimetre; the specimen's left edge is at 50 px."""


@pytest.fixture(scope="module")
def solution():
    """Gradients at the elements' middles (step, row, col, 2, 2) and forces [N] of a square sheet."""
    lines = np.linspace(0.0, SIDE, CELLS + 1)
    found = equilibrium(MODELS["mooney_rivlin"], TRUTH, (lines, lines), SIDE * STRESSES)
    return found.gradients.reshape(3, CELLS, CELLS, 4, 2, 2).mean(axis=3), found.forces * THICKNESS


def places():
    middle = (np.arange(CELLS) + 0.5) * SIDE / CELLS
    x, y = np.meshgrid(middle, middle)
    return np.stack([x, y, np.full_like(x, 500.0)], axis=-1)


def points():
    """The first step's points: on a lattice in the photograph, 3.5 px from the specimen's edges."""
    xy = 50.0 + places()[..., :2] * PX
    attrs = {"step_size": STEP_PX, "subset_size": 21, "shape_function": "affine", "image_size": [300, 400]}
    return Product("points", {"xy": Variable(("row", "col", "image_component"), xy, "px")}, attrs)


def region(left=50.0, right=50.0 + SIDE * PX, holes=()):
    top, bottom = 50.0, 50.0 + SIDE * PX
    return Region.write([Polygon(np.array([[left, top], [right, top], [right, bottom], [left, bottom]]), holes)])


def totals(gradients, sigma=SIGMA, known=None):
    at = np.where(np.ones((CELLS, CELLS), bool)[..., None] if known is None else known[..., None], places(), np.nan)
    facts = TotalFacts("precise", "mm", {}, {"step_size": STEP_PX, "vsg_px": 7.0, "vsg_mm": SIDE / CELLS})
    zero, covariance = np.zeros((CELLS, CELLS)), np.zeros((CELLS, CELLS, 21))
    fields = {name: zero for name in ("U", "V", "W", "exx", "eyy", "gxy")}
    fields |= {f"sigma_{name}": np.full((CELLS, CELLS), sigma) for name in ("exx", "eyy")}
    return [
        Total.write(
            {**fields, "xyz_reference": at, "gradient": one, "covariance": covariance}, zero.astype(np.uint8), facts
        )
        for one in gradients
    ]


def channels(forces, unit="N", steps=("0", "1", "2", "3"), load="load"):
    values = np.append(0.0, forces)
    u = 0.001 + 0.0 * values
    return Channels.write({"load": Channel(values, unit, "load", u)}, steps, load=load)


def sheet(gradients, forces, known=None, outline=None, **given):
    stage = Sheet(**{**SECTION, **given})
    outline = region() if outline is None else outline
    return stage.run(totals(gradients, known=known), points(), channels(forces), outline)


def fitted(gradients, forces, known=None, models=("mooney_rivlin",)):
    return Material.read(VirtualFields(models=models, mesh=(2, 3)).run([sheet(gradients, forces, known)]))


def test_the_width_is_that_of_the_region(solution):
    found = SheetFields.read(sheet(*solution))
    assert found.facts.width == pytest.approx(SIDE, rel=1e-6)
    assert found.facts.u_width == pytest.approx(0.5 * np.sqrt(2) / PX)
    assert found.facts.rim == pytest.approx(1 / CELLS)
    np.testing.assert_allclose(found["areas"].sum(), SIDE * found.facts.length)
    np.testing.assert_allclose(found["slopes"], np.broadcast_to(np.eye(2), found["slopes"].shape), atol=1e-9)


def test_a_given_width_counts_instead(solution):
    facts = SheetFields.read(sheet(*solution, width=58.0, u_width=0.1)).facts
    assert facts.width == pytest.approx(58.0)
    assert facts.u_width == 0.1


def test_constants_and_the_balance_of_forces(solution):
    """Middles of elements instead of their Gauss points: modulus and forces within 0.3 %."""
    found = fitted(*solution)
    (model,) = found.models
    np.testing.assert_allclose(model.values, TRUTH, rtol=0.06)
    np.testing.assert_allclose(np.sum(model.values), TRUTH.sum(), rtol=0.003)
    np.testing.assert_allclose(found["force_balance"], 1.0, atol=0.003)
    assert found.summary["largest_imbalance_pct"] < 0.5
    assert "the mean stress carries the load within" in found.verdict[-1]
    assert model.shear_modulus[0] == pytest.approx(2 * np.sum(model.values))


def test_one_sheet_says_that_nothing_checks_it(solution):
    text = "There is one test, 1: no prediction could be checked; add a specimen of another shape."
    assert text in fitted(*solution).verdict
    both = Material.read(VirtualFields(models=("mooney_rivlin",)).run([sheet(*solution)] * 2))
    assert not any("could be checked" in sentence for sentence in both.verdict)


def test_the_section_is_in_the_interval(solution):
    (model,) = fitted(*solution).models
    share = np.hypot(0.005 / THICKNESS, 0.5 * np.sqrt(2) / PX / SIDE)
    for constant in model.constants:
        assert constant.common == pytest.approx(share * abs(constant.value), rel=0.05)
        assert constant.half_width == pytest.approx(1.96 * np.hypot(constant.common, constant.independent))


def test_noise_within_the_intervals(solution):
    gradients, forces = solution
    noise = SIGMA * np.random.default_rng(4).standard_normal(gradients.shape)
    (clean,), (noisy,) = (fitted(one, forces).models for one in (gradients, gradients + noise))
    for one, other in zip(clean.constants, noisy.constants, strict=True):
        assert abs(one.value - other.value) < 3 * other.independent


def test_two_sheets_predict_each_other(solution):
    both = Material.read(VirtualFields(models=("mooney_rivlin", "neo_hooke")).run([sheet(*solution)] * 2))
    best, simple = both.models
    assert [best.name, simple.name] == ["mooney_rivlin", "neo_hooke"]
    assert max(best.left_out) < 0.01 < max(simple.left_out)
    assert [curve.points for curve in both.curves] == [3, 3]


def test_a_missing_rim_is_said_and_filled(solution):
    gradients, forces = solution
    known = np.zeros((CELLS, CELLS), bool)
    known[:, 2:-2] = True
    found = sheet(gradients, forces, known)
    assert any("the points show 75 % of the width" in text for text in found.warnings)
    np.testing.assert_allclose(fitted(gradients, forces, known)["force_balance"], 1.0, atol=0.01)


def test_a_step_without_points_is_left_out(solution):
    gradients, forces = solution
    listed = totals(gradients)
    listed[1] = totals(gradients, known=np.zeros((CELLS, CELLS), bool))[1]
    found = Sheet(**SECTION).run(listed, points(), channels(forces), region())
    assert SheetFields.read(found).steps == ("1", "3")
    assert found.warnings[0].startswith("1 loaded step has no points and is left out")


def test_a_step_without_a_load_is_left_out_with_a_warning(solution):
    gradients, forces = solution
    found = sheet(gradients, np.array([forces[0], np.nan, forces[2]]))
    assert SheetFields.read(found).steps == ("1", "3")
    assert found.warnings[0] == "1 step has no load and is left out; look at the load's column"


def test_repeated_steps_change_no_constant(solution):
    gradients, forces = solution
    steps = [0, 0, 1, 1, 2, 2]
    products = totals(gradients[steps])
    loads = channels(forces[steps], steps=tuple("0123456"))
    twice = VirtualFields(models=("mooney_rivlin",), mesh=(2, 3)).run(
        [Sheet(**SECTION).run(products, points(), loads, region())]
    )
    once = fitted(gradients, forces).models[0]
    np.testing.assert_allclose(Material.read(twice).models[0].values, once.values, rtol=2e-3)


def test_a_measurement_of_one_camera_is_refused(solution):
    flat = [replace(one, attrs={**one.attrs, "scale": 1.0}) for one in totals(solution[0])]
    with pytest.raises(StageError, match="virtual work needs lengths in mm; measure with two cameras"):
        Sheet(**SECTION).run(flat, points(), channels(solution[1]), region())


def test_a_thickness_whose_uncertainty_lacks_its_unit_is_refused():
    with pytest.raises(ValueError, match=r"u_thickness is 5 mm for a thickness of 0\.21 mm"):
        Sheet(thickness=0.21, u_thickness=5)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"width": 40.0}, "the points are 57.0 mm wide, more than the width of 40 mm"),
        ({"outline": region(left=0.5)}, "the left edge of the specimen is not in view"),
        ({"outline": region(right=299.0)}, "the right edge of the specimen is not in view"),
        ({"outline": region(holes=(np.array([[90.0, 90], [95, 90], [95, 95]]),))}, "the region has holes"),
    ],
)
def test_sides_that_do_not_fit_are_refused(solution, given, message):
    with pytest.raises(StageError, match=message):
        sheet(*solution, **given)


def test_a_width_that_nobody_knows_is_asked_for(solution):
    with pytest.raises(StageError, match="the width is unknown; give width, or a region"):
        Sheet(**SECTION).run(totals(solution[0]), points(), channels(solution[1]))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"forces": np.zeros(3)}, "no step has both a load above 0 and measured points"),
        ({"unit": "V"}, "has the unit 'V'; expected N"),
        ({"steps": ("0", "1", "2", "4")}, "the channels have no step 3"),
        ({"load": None}, "no channel is the load"),
        ({"forces": np.array([3.0, 2.0, 1.0])}, "the load runs against the stretch"),
        ({"forces": -np.arange(1.0, 4.0)}, "the load is negative, down to -3 N: its sign is reversed"),
        ({"forces": np.full(3, np.nan)}, "no step has both a load above 0 and measured points; look"),
    ],
)
def test_loads_that_do_not_fit_are_refused(solution, given, message):
    stage = Sheet(**SECTION, phase="both")
    with pytest.raises(StageError, match=message):
        stage.run(totals(solution[0]), points(), channels(**{"forces": solution[1], **given}), region())


def test_a_load_that_falls_while_the_sheet_grows_is_refused_though_its_peak_comes_first(solution):
    """The first step has the largest load, so that loading is one step."""
    with pytest.raises(StageError, match="the load runs against the stretch"):
        Sheet(**SECTION).run(totals(solution[0]), points(), channels(np.array([3.0, 2.0, 1.0])), region())


def test_no_cell_is_smaller_than_the_noise_can_tell(solution):
    """A gauge of 24 points, 72 mm: its bumps are 18 mm wide, and of ten cells along 57 mm three are left."""
    found = sheet(*solution)
    facts = {**found.attrs["sheet"], "shared": 24.0**2}
    fine, coarse = (
        Material.read(
            VirtualFields(models=("mooney_rivlin",), mesh=mesh).run(
                [replace(found, attrs={**found.attrs, "sheet": facts})]
            )
        )
        for mesh in ((3, 10), (3, 3))
    )
    assert fine.models[0].freedom == coarse.models[0].freedom


def test_errors_of_points_that_are_left_out_do_not_count(solution):
    """Windows of three rows: the first and the last row are cut, and have ten times the error."""
    gradients, forces = solution
    by_row = np.full((CELLS, 1), SIGMA)
    by_row[[0, -1]] *= 10.0
    listed = [
        replace(
            one,
            variables={**one.variables, "bias_exx": one.variables["sigma_exx"], "bias_eyy": one.variables["sigma_eyy"]},
            attrs={**one.attrs, "vsg_px": 3.0 * STEP_PX},
        )
        for one in totals(gradients, by_row)
    ]
    found = SheetFields.read(Sheet(**SECTION).run(listed, points(), channels(forces), region()))
    for name in ("u_gradient", "u_bias"):
        np.testing.assert_allclose(found[name], SIGMA)


def test_a_field_without_points_is_refused(solution):
    with pytest.raises(StageError, match="no step of loading has both"):
        sheet(*solution, known=np.zeros((CELLS, CELLS), bool))


def test_fewer_rows_than_needed_are_refused(solution):
    known = np.zeros((CELLS, CELLS), bool)
    known[:3] = True
    with pytest.raises(StageError, match="3 rows of points are known at all loaded steps"):
        sheet(*solution, known=known)


def test_models_with_more_constants_than_steps_are_named(solution):
    with pytest.raises(StageError, match="ogden_2: 3 points for 4 constants"):
        fitted(*solution, models=("ogden_2",))
