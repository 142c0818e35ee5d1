"""Scatter at steps at rest beside the stated σ, on points of known errors."""

from types import SimpleNamespace

import numpy as np
import pytest
from measured_points import SHAPE, first_points, points, sheet, template_errors

from dicflow.comparison.rest import (
    StillSteps,
    pattern_at_rest,
    probe_scatter,
    scatter_at_rest,
    steps_at_rest,
    strain_over_sigma,
)
from dicflow.engine.product import Product
from dicflow.kinds.noise_floor import NoiseFloorTable
from dicflow.kinds.probes import ProbeTable
from dicflow.kinds.total import Total
from dicflow.report import rest as module
from dicflow.stages.deformation import Deformation

FLAT = sheet()
ROW = np.arange(SHAPE[0])[:, None] / SHAPE[0]
WAVE = 0.01 * np.sin(2.0 * ROW)[..., None] * [0.0, 1.0, 0.0]
"""A slow mode of V over the specimen [mm], several times its σ."""


def measured(rng, extra=0.0, common=None, first=None):
    common = template_errors(rng) if common is None else common
    first = first_points(FLAT, rng, common) if first is None else first
    return Deformation().run(points=points(FLAT + extra, rng, common), points_first=first)


def at_rest(extra=0.0, steps=3, seed=3):
    """Totals of steps at rest, with a further field in each but the first photographs."""
    rng = np.random.default_rng(seed)
    common = template_errors(rng)
    first = first_points(FLAT, rng, common)
    return [Total.read(measured(rng, extra, common, first)) for _ in range(steps)]


@pytest.fixture(scope="module")
def quiet():
    return at_rest()


@pytest.fixture(scope="module")
def waved():
    return at_rest(WAVE)


def stored(totals, noise=None):
    """A result that holds totals, and perhaps a noise floor."""
    names = [f"s{k}" for k in range(len(totals))]
    stages = {"total": ["total"], "noise": ["noise"] if noise is not None else []}
    return SimpleNamespace(
        stages_of=lambda kind: stages.get(kind, []),
        source=lambda stage, port: "total",
        steps=lambda stage: names,
        has=lambda stage, step=None: True,
        product=lambda stage, step=None: noise if stage == "noise" else totals[names.index(step)].product,
    )


def test_noise_alone_scatters_as_stated(quiet):
    found = scatter_at_rest(StillSteps.of(quiet))
    assert [one.name for one in found] == ["U", "V", "W", "exx", "eyy", "gxy"]
    assert [one.unit for one in found] == ["mm"] * 3 + ["1"] * 3
    for one in found:
        assert one.ratio == pytest.approx(1.0, abs=0.25)
        assert not one.exceeds
    assert found[0].chance == pytest.approx(1.36 / np.sqrt(2 * SHAPE[0] * SHAPE[1] / 9))


def test_noise_alone_is_neither_smooth_nor_more_common_than_the_first_photographs(quiet):
    found = pattern_at_rest(StillSteps.of(quiet), "W")
    assert 0.2 < found.common < 0.75
    assert found.smooth < 0.5
    assert found.rest == pytest.approx(1.0, abs=0.25)
    assert pattern_at_rest(StillSteps.of(quiet[:1]), "W").common is None


def test_a_mode_of_all_points_exceeds_and_is_recognised(waved):
    found = {one.name: one for one in scatter_at_rest(StillSteps.of(waved))}
    assert found["V"].exceeds
    assert not found["U"].exceeds
    pattern = pattern_at_rest(StillSteps.of(waved), "V")
    assert pattern.common > 0.75
    assert pattern.smooth > 0.5
    assert pattern.rest == pytest.approx(1.0, abs=0.25)


def test_a_motion_of_the_whole_specimen_is_no_scatter(quiet):
    moved = at_rest(np.array([0.5, -0.3, 2.0]))
    for one, other in zip(scatter_at_rest(StillSteps.of(moved)), scatter_at_rest(StillSteps.of(quiet)), strict=True):
        assert one.found == pytest.approx(other.found, rel=1e-3)


def test_steps_at_rest_are_those_without_strain_or_those_of_the_noise_floor(quiet):
    stretched = Total.read(measured(np.random.default_rng(5), (FLAT - FLAT[0, 0]) * [0.0, 0.02, 0.0]))
    assert strain_over_sigma(quiet[0]) < 1.5 < strain_over_sigma(stretched)
    assert steps_at_rest(stored([quiet[0], stretched, quiet[1]]), "total") == ("s0", "s2")
    floor = NoiseFloorTable.write({}, ["s1"], [], [], {})
    assert steps_at_rest(stored([quiet[0], stretched], floor), "total") == ("s1",)


def test_an_extensometer_has_the_root_mean_square_of_its_strains():
    rows = [
        {"probe": name, "kind": kind, "step": step, "strain": value, "sigma_strain": 1e-4}
        for name, kind, step, value in (
            ("E", "extensometer", "a", 3e-4),
            ("E", "extensometer", "b", -4e-4),
            ("E", "extensometer", "loaded", 0.1),
            ("F", "extensometer", "a", None),
            ("P", "point", "a", 1.0),
        )
    ]
    table = ProbeTable.read(Product("probes", {}, {"rows": rows}))
    (found,) = probe_scatter(table, ("a", "b"))
    assert found.name == "strain of E"
    assert found.found == pytest.approx(np.sqrt(12.5) * 1e-4)
    assert found.ratio == pytest.approx(np.sqrt(12.5))
    assert found.exceeds
    assert module._probe_sentence(found, 2) == (
        "At rest (2 steps) the strain of E scatters by 3.5·10⁻⁴, 3.5 times its stated σ, more than chance allows."
    )


def test_the_report_warns_once_and_says_that_it_is_no_noise_of_points(waved, quiet):
    found = module._found(stored(waved), "total")
    assert found.steps == ("s0", "s1", "s2")
    assert found.warning.startswith("At rest (3 steps) V scatters by 0.00")
    assert "it is no noise of the points" in found.warning
    assert "the same at all these steps" in found.warning
    assert "vibration" in found.warning
    marked = [row[0] for row in found.rows if row[-1]]
    assert "V [mm]" in marked
    assert "U [mm]" not in marked
    assert module._found(stored(quiet), "total").warning == ""


def test_scatter_from_point_to_point_has_other_causes():
    rough = 0.0025 * np.random.default_rng(9).normal(size=(*SHAPE, 1)) * [0.0, 1.0, 0.0]
    found = module._found(stored(at_rest(rough)), "total")
    assert "changes of the light" in found.warning
    assert "no noise of the points" not in found.warning


def test_a_total_without_uncertainty_has_no_scatter():
    thesis = Product("total", {}, {"summary": {"mean_exx": 0.0, "mean_eyy": 0.0}})
    assert module._found(stored([Total(thesis)]), "total") is None
