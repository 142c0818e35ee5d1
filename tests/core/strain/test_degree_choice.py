"""The degree of each point's strain: exact polynomials, pure noise, waves, and the field around a hole."""

import numpy as np
import pytest

from dicflow.core.strain.deformation_gradient import ErrorShare, measured_surface
from dicflow.core.strain.degree_choice import candidate_fits, chosen_gradient
from dicflow.core.strain.remaining_bias import WindowFit
from dicflow.core.uncertainty.overlap import overlap
from tests.noise import point_errors

STEP, SUBSET, WINDOW, NOISE_PX = 7, 31, (7, 7), 0.01
SHAPE = (60, 60)
ROW, COL = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
X, Y = COL * STEP, ROW * STEP
RIM = np.ones(SHAPE, dtype=bool)
RIM[3:-3, 3:-3] = False
ALL = np.ones(SHAPE, dtype=bool)


def measured(displacement, seed=None, noise=NOISE_PX, known=ALL):
    """Points of a plane with a displacement (row, col, 2) [px], with errors as overlapping subsets have them."""
    reference = np.stack([X, Y, 0.0 * X], axis=-1)
    deformed = reference.copy()
    deformed[..., :2] += displacement
    if seed is not None:
        rng = np.random.default_rng(seed)
        deformed[..., :2] += point_errors(rng, SHAPE, noise**2 * np.eye(2), SUBSET, STEP)
    deformed[~known] = np.nan
    covariance = np.diag([noise**2, noise**2, 1e-12, 0.0, 0.0, 0.0])
    share = ErrorShare(np.broadcast_to(covariance, (*SHAPE, 6, 6)), overlap(SUBSET, STEP))
    return measured_surface(reference, deformed, [share])


def chosen(surface, degree="auto"):
    return chosen_gradient(surface, candidate_fits(WINDOW, degree))


def scores(found, truth):
    """Errors of the gradient (row, col, 4) over σ, and over the combined uncertainty."""
    errors = (found.surface.gradient - truth).reshape(*SHAPE, 4)
    noise, bias = (np.diagonal(moments, axis1=-2, axis2=-1) for moments in (found.surface.covariance, found.bias))
    return np.abs(errors / np.sqrt(noise)), np.abs(errors / np.sqrt(noise + bias))


def wave(length, strain):
    """Displacement u = A sin 2πx / λ, and its gradient."""
    k = 2.0 * np.pi / length
    gradient = np.zeros((*SHAPE, 2, 2))
    gradient[..., 0, 0], gradient[..., 1, 1] = 1.0 + strain * np.cos(k * X + 0.3), 1.0
    return np.stack([strain / k * np.sin(k * X + 0.3), 0.0 * X], axis=-1), gradient


def assert_covers(shares_of, tolerances=(0.05, 0.03)):
    """68 % within u, 95 % within 2 u."""
    for sigmas, expected, tolerance in zip((1.0, 2.0), (0.683, 0.954), tolerances, strict=True):
        assert (shares_of < sigmas).mean() == pytest.approx(expected, abs=tolerance)


def test_candidates():
    fits = candidate_fits((7, 7), "auto")
    assert fits == [WindowFit((7, 7), 1), WindowFit((7, 7), 2), WindowFit((7, 7), 3), WindowFit((5, 5), 3)]
    assert candidate_fits((7, 7), 5) == [WindowFit((7, 7), 5)]
    assert candidate_fits((3, 3), "auto") == [WindowFit((3, 3), degree) for degree in (1, 2, 3)]
    assert [WindowFit((side, side), 1).pilot for side in (3, 5, 7, 11)] == [(5, 5), (9, 9), (11, 11), (17, 17)]


@pytest.mark.parametrize(("power", "degrees"), [(1, {1}), (2, {1, 2}), (3, {1, 2, 3})])
def test_polynomials_are_exact_everywhere(power, degrees):
    """A hole and rims included: no window has too low a degree, and none a higher one than the field."""
    x, y = X / 200.0 - 1.0, Y / 200.0 - 0.7
    fields = {1: (x + y, y), 2: (x**2 + x * y, y**2), 3: (x**3 + x * y**2, y**3)}
    slopes = {
        1: ((1, 1), (0, 1)), 2: ((2 * x + y, x), (0, 2 * y)), 3: ((3 * x**2 + y**2, 2 * x * y), (0, 3 * y**2)),
    }  # fmt: skip
    known = np.hypot(ROW - 30, COL - 25) > 6
    truth = np.broadcast_to(np.eye(2), (*SHAPE, 2, 2)).copy()
    for i in range(2):
        for j in range(2):
            truth[..., i, j] += slopes[power][i][j] / 200.0
    found = chosen(measured(np.stack(fields[power], axis=-1), noise=1e-6, known=known))
    assert set(found.degree[known]) <= degrees
    assert found.degree[known].max() == power
    assert np.abs(found.surface.gradient - truth)[known].max() < 1e-8
    assert (found.degree[~known] == 0).all()


def test_noise_alone_keeps_degree_1():
    """No price for the choice, and σ is true; at rims too."""
    found = [chosen(measured(np.zeros((*SHAPE, 2)), seed)) for seed in range(6)]
    assert np.mean([one.degree == 1 for one in found]) > 0.98
    assert max(np.mean([one.degree[where] == 1 for one in found]) for where in (RIM, ~RIM)) > 0.95
    spread = [np.mean((one.surface.gradient - np.eye(2)) ** 2) for one in found]
    plain = [chosen(measured(np.zeros((*SHAPE, 2)), seed), 1).surface.gradient - np.eye(2) for seed in range(6)]
    assert np.sqrt(np.mean(spread) / np.mean(np.square(plain))) < 1.05
    sigma, combined = (np.stack(parts) for parts in zip(*(scores(one, np.eye(2)) for one in found), strict=True))
    assert_covers(sigma)
    assert_covers(combined)
    assert_covers(combined[:, RIM])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("length", "strain"), [(600.0, 0.03), (300.0, 0.01), (150.0, 0.01), (150.0, 0.1), (80.0, 0.01)]
)
def test_uncertainty_covers_a_wave(length, strain):
    """In the interior and at the rims, where fits are one-sided."""
    displacement, truth = wave(length, strain)
    combined = np.stack([scores(chosen(measured(displacement, seed)), truth)[1] for seed in range(4)])
    assert_covers(combined[:, ~RIM])
    assert_covers(combined[:, RIM])
    assert (combined > 3.0).mean() < 0.01


def test_threads_change_nothing():
    surface = measured(wave(300.0, 0.02)[0], seed=3)
    one, two = (chosen(surface._replace(threads=threads)) for threads in (1, 2))
    for first, second in zip((*one.surface, *one[1:]), (*two.surface, *two[1:]), strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(("length", "strain"), [(300.0, 0.01), (300.0, 0.03), (150.0, 0.01)])
def test_a_fixed_degree_states_its_bias(length, strain):
    """Degree 1 by force: root mean square of the stated bias against that of the exact field's."""
    displacement, truth = wave(length, strain)
    inside = (slice(6, -6), slice(6, -6))
    found = chosen(measured(displacement, 1), 1)
    error = (chosen(measured(displacement, noise=1e-6), 1).surface.gradient - truth)[inside][..., 0, 0]
    stated = np.sqrt(found.bias[inside][..., 0, 0].mean())
    assert stated == pytest.approx(np.sqrt((error**2).mean()), rel=0.3)
    assert (found.degree == 1).all()


def test_a_bias_that_only_the_outermost_points_have_is_stated():
    """Strain that changes evenly, degree 1 by force: it is biased in one-sided windows, and the cells around have none.

    Within a window the bias falls from 5 σ to nothing.
    """
    slope = 2e-4
    truth = np.broadcast_to(np.eye(2), (*SHAPE, 2, 2)).copy()
    truth[..., 0, 0] += slope * X
    surfaces = [measured(np.stack([0.5 * slope * X**2, 0.0 * X], axis=-1), seed) for seed in range(2)]
    sigma, combined = zip(*(scores(chosen(surface, 1), truth) for surface in surfaces), strict=True)
    outermost = np.s_[:, 3:-3, [0, -1], 0]
    assert (np.array(sigma)[outermost] > 3.0).mean() > 0.9
    assert (np.array(combined)[outermost] > 3.0).mean() < 0.01
    assert np.sqrt(np.mean(np.array(combined)[outermost] ** 2)) == pytest.approx(1.0, abs=0.2)


def around_hole(x, y, radius, strain, nu=0.33):
    """Displacement of a sheet with a hole under uniaxial tension along x (Kirsch 1898, plane stress)."""
    r, angle = np.maximum(np.hypot(x, y), 0.5 * radius) / radius, np.arctan2(y, x)
    kappa, shear = (3.0 - nu) / (1.0 + nu), 0.5 / (1.0 + nu)
    c, s = np.cos(2.0 * angle), np.sin(2.0 * angle)
    radial = r * (kappa - 1.0 + 2.0 * c) + 2.0 / r * (1.0 + (kappa + 1.0) * c) - 2.0 / r**3 * c
    around = -2.0 * r * s + 2.0 / r * (1.0 - kappa) * s - 2.0 / r**3 * s
    u = radial * np.cos(angle) - around * np.sin(angle), radial * np.sin(angle) + around * np.cos(angle)
    return strain * radius / (8.0 * shear) * np.stack(u, axis=-1)


def test_stress_is_three_times_as_large_beside_the_hole():
    """The formula itself: εxx = 3 σ / E at the hole's edge across the load."""
    high, low = (around_hole(np.array([x]), np.array([50.0]), 50.0, 1e-3)[0, 0] for x in (1e-3, -1e-3))
    assert (high - low) / 2e-3 == pytest.approx(3e-3, rel=1e-4)


@pytest.mark.parametrize(("radius", "strain"), [(80.0, 0.01), (130.0, 0.003), (130.0, 0.01)])
def test_uncertainty_covers_the_field_around_a_hole(radius, strain):
    """In all points, and in those whose window the hole or an edge cuts."""
    x, y, h = X - X.mean() - 2.0, Y - Y.mean() + 1.0, 1e-3
    ahead, back = (
        [around_hole(x + sign * dx, y + sign * dy, radius, strain) for dx, dy in ((h, 0.0), (0.0, h))]
        for sign in (1.0, -1.0)
    )
    truth = np.stack([(one - other) / (2.0 * h) for one, other in zip(ahead, back, strict=True)], axis=-1) + np.eye(2)
    known = np.hypot(x, y) > radius + 3.0
    cut = known & (RIM | (np.hypot(x, y) < radius + 4 * STEP))
    displacement = around_hole(x, y, radius, strain)
    found = [chosen(measured(displacement, seed, known=known)) for seed in range(4)]
    combined = np.stack([scores(one, truth)[1] for one in found])
    assert_covers(combined[:, known])
    assert_covers(combined[:, cut])
    assert (combined[:, known] > 3.0).mean() < 0.01
