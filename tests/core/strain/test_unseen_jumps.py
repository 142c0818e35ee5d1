"""Jumps that no lost points mark, on points with the noise of overlapping subsets."""

import numpy as np
import pytest

from dicflow.core.strain.deformation_gradient import ErrorShare, measured_surface
from dicflow.core.strain.degree_choice import candidate_fits, chosen_gradient
from dicflow.core.strain.small_jumps import NORMALS, GridOfSubsets, jumps_at_points
from dicflow.core.strain.unseen_jumps import cut_by_jumps, unseen_jumps
from dicflow.core.uncertainty.overlap import overlap
from tests.noise import point_errors

STEP, SUBSET, WINDOW, NOISE_PX = 7, 31, 7, 0.005
SHAPE = (50, 70)
ROW, COL = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
ROWS_FROM_LINE = ROW - 24.3
SUBSETS = GridOfSubsets(SUBSET, STEP, "affine")
NOWHERE = np.zeros(SHAPE, dtype=bool)


def measured(displacement, seed=None, lost=NOWHERE, growth=None):
    """Points of a plane [px] with a displacement (row, col) along y, and errors as overlapping subsets have them.

    growth : (row, col) — of the errors of subsets that are worse than others from the first step on
    """
    growth = np.ones((*SHAPE, 1)) if growth is None else growth[..., None]
    reference = STEP * np.stack([COL, ROW, 0.0 * ROW], axis=-1)
    deformed = reference.copy()
    deformed[..., 1] += displacement
    if seed is not None:
        rng = np.random.default_rng(seed)
        deformed[..., :2] += growth * point_errors(rng, SHAPE, NOISE_PX**2 * np.eye(2), SUBSET, STEP)
    deformed[lost] = np.nan
    covariance = 0.5 * NOISE_PX**2 * np.diag([1.0, 1.0, 0.0, 1.0, 1.0, 0.0])
    share = ErrorShare(growth[..., None] ** 2 * covariance, overlap(SUBSET, STEP))
    return measured_surface(reference, deformed, [share])


def ramp(jump):
    """What affine subsets measure of a jump [px] across the line."""
    return jump * np.clip(ROWS_FROM_LINE * STEP / SUBSET, -0.5, 0.5)


def bent():
    """A field of degree 3, with 3 % strain at the corners."""
    x, y = COL / 35.0 - 1.0, ROW / 25.0 - 1.0
    return 0.9 * (y**3 + x * y**2) + 2.0 * x * x


def wrong_strain(surface, jumps):
    """εyy of a plate without strain over σ, and over the uncertainty with the bias by the jumps."""
    found = chosen_gradient(surface, candidate_fits((WINDOW, WINDOW), 1), jumps)
    error = np.abs(found.surface.gradient[..., 1, 1] - 1.0)
    variance, bias = found.surface.covariance[..., 3, 3], found.bias[..., 3, 3]
    return error / np.sqrt(variance), error / np.sqrt(variance + bias)


@pytest.mark.parametrize("shape", ["affine", "quadratic"])
def test_profile(shape):
    """Odd, from −1/2 to 1/2 over a subset along the grid; a third of an affine subset is beyond at a sixth of it."""
    subsets = SUBSETS._replace(shape_function=shape)
    for normal in NORMALS:
        far = subsets.profile(np.array([-9.0, 0.0, 9.0]), normal)
        assert far == pytest.approx([-0.5, 0.0, 0.5], abs=1e-9)
        assert subsets.profile(np.array([-1.3]), normal) == pytest.approx(-subsets.profile(np.array([1.3]), normal))
    if shape == "affine":
        along = subsets.profile(np.array([SUBSET / 6.0 / STEP]), NORMALS[0])
        assert along == pytest.approx([1.0 / 6.0], abs=0.02)


@pytest.mark.parametrize("direction", range(4))
def test_a_jump_is_measured_in_a_bent_field(direction):
    """On its line it has its size, with any smooth motion of degree 3 around it."""
    normal = NORMALS[direction]
    distance = (ROW - 25) * normal[0] + (COL - 35) * normal[1]
    found = jumps_at_points(measured(0.3 * SUBSETS.profile(distance, normal) + bent()), NOWHERE, SUBSETS)
    on_line = np.abs(distance) < 1e-6
    on_line[:9], on_line[-9:], on_line[:, :9], on_line[:, -9:] = False, False, False, False
    assert on_line.sum() > 20
    assert (found.direction[on_line] == direction).all()
    assert np.abs(found.jump[on_line][:, 1]) == pytest.approx(0.3, rel=1e-6)


def test_noise_of_a_jump():
    """Its squares are χ² with two degrees of freedom at rims, where a single direction has all its points."""
    found = np.stack([jumps_at_points(measured(bent(), seed), NOWHERE, SUBSETS).significance for seed in range(30)])
    assert found.max() < 6.0
    squares = found[:, 10:-10, [3, 4, 5, 6, -7, -6, -5, -4]] ** 2
    assert squares.min() > 0.0
    assert squares.mean() == pytest.approx(2.0, rel=0.15)
    assert (squares > 2.0 * np.log(20.0)).mean() == pytest.approx(0.05, abs=0.02)


def test_smooth_motion_and_noise_have_none():
    assert all(unseen_jumps(measured(bent(), seed), NOWHERE, SUBSETS, WINDOW) is None for seed in range(6))


def test_steep_smooth_motion_has_none():
    """Of degree 5 across the lines, which a fit of degree 3 takes for a jump of 20 σ."""
    steep = 12.0 * (ROW / 25.0 - 1.0) ** 5
    assert all(unseen_jumps(measured(steep, seed), NOWHERE, SUBSETS, WINDOW) is None for seed in range(4))


def test_points_that_scatter_more_than_stated_have_none():
    growth = np.full(SHAPE, 2.0)
    for seed in range(4):
        surface = measured(bent(), seed, growth=growth)
        stated = [one._replace(covariance=one.covariance / 4.0) for one in surface.errors]
        assert unseen_jumps(surface._replace(errors=stated), NOWHERE, SUBSETS, WINDOW) is None


def test_subsets_that_a_rim_cuts_have_none():
    """Their larger errors are no jumps; a jump among them is one as soon as it stands out against these."""
    growth = np.where(np.abs(COL - 34.5) > 32.0, 5.0, 1.0)
    assert all(
        unseen_jumps(measured(bent(), seed, growth=growth), NOWHERE, SUBSETS, WINDOW) is None for seed in range(6)
    )
    found = unseen_jumps(measured(ramp(0.3), 1, growth=growth), NOWHERE, SUBSETS, WINDOW)
    on_line = np.abs(ROWS_FROM_LINE) < 1.0
    assert np.abs(found.jump[on_line][:, 1]) == pytest.approx(0.3, abs=0.15)


@pytest.mark.parametrize("jump", [0.1, 0.3])
def test_a_crack_that_no_point_shows(jump):
    """Strain along the whole line is beyond 3 σ, and within 3 u; away from it u is σ nearly everywhere."""
    surface = measured(ramp(jump), 1)
    scaled, stated = wrong_strain(surface, unseen_jumps(surface, NOWHERE, SUBSETS, WINDOW))
    line, away = np.abs(ROWS_FROM_LINE) < 2.0, np.abs(ROWS_FROM_LINE) > 14.0
    line[:, :4] = line[:, -4:] = False
    assert (scaled[line] > 3.0).mean() > 0.95
    assert (stated[line] > 3.0).mean() < 0.01
    assert (stated[away] > 0.9 * scaled[away]).mean() > 0.9


def test_a_crack_towards_its_tip():
    """It is lost where it opens wide; from there to its tip displacements and strains are within 3 u."""
    opening = 2.0 * np.maximum(1.0 - COL / 50.0, 0.0) ** 2
    lost = (np.abs(ROWS_FROM_LINE) < 2.3) & (opening > 0.4)
    surface = measured(ramp(opening), 2, lost)
    jumps = unseen_jumps(surface, lost, SUBSETS, WINDOW)
    scaled, stated = wrong_strain(surface, jumps)
    beside = (np.abs(ROWS_FROM_LINE) < SUBSET / STEP) & (COL > 3) & (COL < 54) & ~lost
    assert (scaled[beside] > 3.0).mean() > 0.2
    assert (stated[beside] > 3.0).mean() < 0.01
    wrong = np.abs(ramp(opening) - 0.5 * opening * np.sign(ROWS_FROM_LINE))
    near_tip = (opening < 0.4) & (opening > 0.0)
    u = np.hypot(jumps.of_places()[..., 1], NOISE_PX)
    assert (wrong > 3.0 * NOISE_PX)[near_tip].mean() > 0.01
    assert (wrong > 2.0 * u)[near_tip].mean() < 0.002


def test_what_a_line_leaves_beside_it_does_not_hide_where_it_goes_on():
    """Of a crack that opens slowly, over six draws of the noise; without the rule for lines beside, twice as many."""
    opening = 0.6 * np.maximum(1.0 - COL / 50.0, 0.0) ** 2
    lost = (np.abs(ROWS_FROM_LINE) < 2.3) & (opening > 0.4)
    beside = (np.abs(ROWS_FROM_LINE) < SUBSET / STEP) & (COL > 3) & (COL < 54) & ~lost
    surfaces = (measured(ramp(opening), seed, lost) for seed in range(6))
    stated = [wrong_strain(one, unseen_jumps(one, lost, SUBSETS, WINDOW))[1][beside] for one in surfaces]
    assert (np.array(stated) > 3.0).mean() < 0.015


LONG_GAP = (np.abs(ROWS_FROM_LINE) < 2.3) & (COL < 25)
"""Lost points along a crack whose tip is 11 columns further."""


def test_ahead_of_a_long_gap_a_jump_counts_that_is_not_significant():
    """Over six draws of the noise of a crack that ends as the root of the distance; by significance alone, a third."""
    opening = 0.045 * np.sqrt(np.clip((36.0 - COL) / 12.0, 0.0, None))
    ahead = (np.abs(ROWS_FROM_LINE) < SUBSET / STEP) & (COL >= 25) & (COL < 36)
    surfaces = [measured(ramp(opening), seed, LONG_GAP) for seed in range(6)]
    found = [wrong_strain(one, unseen_jumps(one, LONG_GAP, SUBSETS, WINDOW)) for one in surfaces]
    scaled, stated = (np.array([one[ahead] for one in kind]) for kind in zip(*found, strict=True))
    assert (scaled > 3.0).mean() > 0.4
    assert (stated > 3.0).mean() < 0.02


def test_ahead_of_a_long_gap_without_a_jump_u_stays_small():
    """What noise makes of a jump there is at most 2 σ on the average; elsewhere u is σ."""
    ahead = (np.abs(ROWS_FROM_LINE) < SUBSET / STEP) & (COL >= 25) & (COL < 36)
    ratios = []
    for seed in range(6):
        surface = measured(0.0 * ROW, seed, LONG_GAP)
        scaled, stated = wrong_strain(surface, unseen_jumps(surface, LONG_GAP, SUBSETS, WINDOW))
        ratios.append(scaled / stated)
    assert np.mean([one[ahead] for one in ratios]) < 2.5
    assert np.nanmean([one[:, 45:] for one in ratios]) < 1.05


@pytest.mark.parametrize("gap", [np.hypot(ROW - 24, COL - 20) < 7.0, (np.abs(ROWS_FROM_LINE) < 2.3) & (COL < 8)])
def test_ahead_of_a_gap_that_is_not_long_nothing_counts(gap):
    """Round, or shorter than two subsets, at a rim too."""
    assert all(unseen_jumps(measured(bent(), seed, gap), gap, SUBSETS, WINDOW) is None for seed in range(4))


def test_places_beside_a_crack_lie_between_both_sides():
    """Half of the jump on the line, nothing beyond half a subset."""
    opening = np.full(SHAPE, 0.3)
    lost = (np.abs(ROWS_FROM_LINE) < 2.0) & (COL < 20)
    off = unseen_jumps(measured(ramp(opening), lost=lost), lost, SUBSETS, WINDOW).of_places()[..., 1]
    on_line = off[24, 25:60]
    assert on_line == pytest.approx(0.15, rel=0.15)
    assert off[24 + 3 :].max() == pytest.approx(0.0, abs=1e-12)
    assert off[: 24 - 2].max() == pytest.approx(0.0, abs=1e-12)


def test_points_that_count_for_nothing_are_cut_only_beside_a_jump():
    """Weights are 1/σ²: with 49 points in a window, those whose σ is 8 times that of others, not those with 6 times."""
    lost = (np.abs(ROWS_FROM_LINE) < 1.0) & (COL < 40)
    growth = np.where(np.abs(ROWS_FROM_LINE) < 3.0, 8.0, 1.0)
    beside = (np.abs(ROWS_FROM_LINE) < 3.0) & (COL < 39) & ~lost
    cut = cut_by_jumps(measured(bent(), 1, lost, growth), lost, SUBSETS, (WINDOW, WINDOW))
    assert cut[beside].all()
    assert not cut[np.abs(ROWS_FROM_LINE) > 3.0].any()
    assert not cut[:, 46:].any()
    certain = measured(bent(), 1, lost, np.minimum(growth, 6.0))
    assert not cut_by_jumps(certain, lost, SUBSETS, (WINDOW, WINDOW)).any()
