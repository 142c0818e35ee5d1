"""The stage virtual_fields on fields in equilibrium, solved by finite elements."""

import numpy as np
import pytest

from dicflow.core.material.models import MODELS
from dicflow.errors import StageError
from dicflow.kinds.channels import Channel, Channels
from dicflow.kinds.material import Material
from dicflow.kinds.total import Total, TotalFacts
from dicflow.stages.virtual_fields import VirtualFields
from tests.sheets import solve

TRUTH, SIDE, CELLS = np.array([0.18, 0.03]), 60.0, 20
PULLS = SIDE * np.array([0.1, 0.25, 0.5])
THICKNESS, SIGMA = 0.21, 1e-3
SIZE = {"width": SIDE, "thickness": THICKNESS, "u_thickness": 0.005}


@pytest.fixture(scope="module")
def solution():
    """Gradients at the elements' middles (step, row, col, 2, 2) and forces [N] of a square sheet."""
    found = solve(MODELS["mooney_rivlin"], TRUTH, (SIDE, SIDE), (CELLS, CELLS), PULLS)
    return found.gradients.reshape(3, CELLS, CELLS, 4, 2, 2).mean(axis=3), found.forces * THICKNESS


def totals(gradients, sigma=SIGMA, known=None):
    middle = (np.arange(CELLS) + 0.5) * SIDE / CELLS
    x, y = np.meshgrid(middle, middle)
    places = np.stack([x, y, np.full_like(x, 500.0)], axis=-1)
    places = np.where(np.ones((CELLS, CELLS), bool)[..., None] if known is None else known[..., None], places, np.nan)
    facts = TotalFacts("precise", "mm", {}, {"step_size": 7, "vsg_px": 7.0, "vsg_mm": SIDE / CELLS})
    zero, covariance = np.zeros((CELLS, CELLS)), np.zeros((CELLS, CELLS, 21))
    fields = {name: zero for name in ("U", "V", "W", "exx", "eyy", "gxy")}
    fields |= {f"sigma_{name}": np.full((CELLS, CELLS), sigma) for name in ("exx", "eyy")}
    return [
        Total.write(
            {**fields, "xyz_reference": places, "gradient": one, "covariance": covariance},
            zero.astype(np.uint8),
            facts,
        )
        for one in gradients
    ]


def channels(forces, unit="N", steps=("0", "1", "2", "3")):
    values = np.append(0.0, forces)
    return Channels.write({"load": Channel(values, unit, "load", np.full(len(values), 0.001))}, steps, load="load")


def fitted(gradients, forces, known=None, **given):
    stage = VirtualFields(**{**SIZE, **given})
    return Material.read(stage.run(totals(gradients, known=known), channels(forces)))


def test_constants_and_the_balance_of_forces(solution):
    """Middles of elements instead of their Gauss points: modulus and forces within 0.2 %."""
    found = fitted(*solution)
    (model,) = found.models
    np.testing.assert_allclose(model.values, TRUTH, rtol=0.06)
    np.testing.assert_allclose(np.sum(model.values), TRUTH.sum(), rtol=0.002)
    np.testing.assert_allclose(found["force_balance"], 1.0, atol=0.002)
    assert found.summary["largest_imbalance_pct"] < 1.0
    assert "The mean stress carries the load within" in " ".join(found.verdict)
    assert model.shear_modulus[0] == pytest.approx(2 * np.sum(model.values))


def test_the_thickness_is_in_the_interval(solution):
    (model,) = fitted(*solution).models
    for constant in model.constants:
        assert constant.common == pytest.approx(0.005 / THICKNESS * abs(constant.value), rel=0.05)
        assert constant.half_width == pytest.approx(1.96 * np.hypot(constant.common, constant.independent))


def test_noise_within_the_intervals(solution):
    gradients, forces = solution
    noise = SIGMA * np.random.default_rng(4).standard_normal(gradients.shape)
    (clean,), (noisy,) = (fitted(one, forces).models for one in (gradients, gradients + noise))
    for one, other in zip(clean.constants, noisy.constants, strict=True):
        assert abs(one.value - other.value) < 3 * other.independent


def test_a_missing_rim_is_said(solution):
    gradients, forces = solution
    known = np.zeros((CELLS, CELLS), bool)
    known[:, 2:-2] = True
    found = fitted(gradients, forces, known)
    assert any("The points show 80 % of the width" in text for text in found.product.warnings)
    np.testing.assert_allclose(found["force_balance"], 1.0, atol=0.05)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": 40.0}, "the points are 60.0 mm wide, more than the width of 40 mm"),
        ({"model": "ogden_2"}, "3 points for 4 constants"),
    ],
)
def test_sizes_and_models_that_do_not_fit_are_refused(solution, change, message):
    with pytest.raises(StageError, match=message):
        fitted(*solution, **change)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"forces": np.zeros(3)}, "no step has both a load above 0 and measured points"),
        ({"unit": "V"}, "has the unit 'V'; expected N"),
        ({"steps": ("0", "1", "2", "4")}, "the channels have no step 3"),
    ],
)
def test_loads_that_do_not_fit_are_refused(solution, given, message):
    stage = VirtualFields(**SIZE)
    with pytest.raises(StageError, match=message):
        stage.run(totals(solution[0]), channels(**{"forces": solution[1], **given}))


def test_a_field_without_points_is_refused(solution):
    with pytest.raises(StageError, match="no step has both"):
        fitted(*solution, known=np.zeros((CELLS, CELLS), bool))
