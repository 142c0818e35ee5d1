"""Values between the points, exact for the fields that they should follow, and σ against the scatter."""

import numpy as np
import pytest
from scipy import signal

from dicflow.core.probes.weights import (
    Probe,
    _autocorrelation,
    _correlated,
    area_probe,
    difference,
    mean_probe,
    point_probe,
    sample_probes,
    sigma_of,
    strain_correlation,
    value_of,
)
from dicflow.core.strain.deformation_gradient import ErrorShare, measured_surface
from dicflow.core.strain.degree_choice import chosen_gradient
from dicflow.core.strain.remaining_bias import WindowFit
from dicflow.core.uncertainty.overlap import independent, overlap
from tests.noise import point_errors

SHAPE, STEP, SUBSET = (20, 16), 5, 21
GRID = np.stack(np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0])), axis=-1) * float(STEP) + [100.0, 50.0]

ALL = np.ones(SHAPE, dtype=bool)
X, Y = np.moveaxis(GRID, -1, 0)
CURVED = 2.0 + 0.1 * X - 0.3 * Y + 0.01 * X * Y + 0.002 * Y**2


def line(places):
    return mean_probe([point_probe(GRID, ALL, place, STEP) for place in places])


def curved(x, y):
    return 2.0 + 0.1 * x - 0.3 * y + 0.01 * x * y + 0.002 * y**2


@pytest.mark.parametrize("place", [(133.7, 88.8), (100.0, 50.0), (98.0, 47.0), (175.0, 145.0), (140.0, 149.0)])
def test_a_point_follows_a_parabola_beyond_the_edge_too(place):
    probe = point_probe(GRID, ALL, place, STEP)
    assert value_of(probe, CURVED) == pytest.approx(curved(*place))
    assert probe.weights.sum() == pytest.approx(1.0)


def test_a_point_beside_the_measured_ones_has_no_value():
    assert point_probe(GRID, ALL, (80.0, 60.0), STEP) is None
    assert point_probe(GRID, ~ALL, (120.0, 60.0), STEP) is None
    line = np.zeros(SHAPE, dtype=bool)
    line[5] = True
    assert point_probe(GRID, line, (130.0, 75.0), STEP) is None


def test_few_points_give_a_plane():
    corner = np.zeros(SHAPE, dtype=bool)
    corner[:2, :3] = True
    field = 3.0 - 0.2 * X + 0.5 * Y
    assert value_of(point_probe(GRID, corner, (104.0, 51.0), STEP), field) == pytest.approx(3 - 20.8 + 25.5)


def test_lines_and_areas():
    places = np.linspace([110.0, 60.0], [150.0, 120.0], 41)
    assert value_of(line(places), CURVED) == pytest.approx(curved(*places.T).mean())
    assert line([[110.0, 60.0], [0.0, 0.0]]) is None
    inside = X < 130
    assert value_of(area_probe(inside, ALL), CURVED) == pytest.approx(CURVED[inside].mean())
    assert area_probe(inside, ~inside) is None
    vector = np.stack([X, Y], axis=-1)
    assert np.allclose(value_of(area_probe(inside, ALL), vector), vector[inside].mean(axis=0))


def test_sigma_of_independent_points():
    assert sigma_of(area_probe(ALL, ALL), np.full(SHAPE, 2.0), independent()) == pytest.approx(2 / np.sqrt(ALL.size))


@pytest.mark.slow
@pytest.mark.parametrize("shape_function", ["affine", "quadratic"])
def test_sigma_is_the_scatter(shape_function):
    """Of a point, a line, an area and the difference of two points; 1500 fields, so within 4 of its deviations."""
    probes = [
        point_probe(GRID, ALL, (133.7, 88.8), STEP),
        line(np.linspace([110.0, 60.0], [150.0, 60.0], 9)),
        area_probe((X < 130) & (Y > 100), ALL),
        difference(point_probe(GRID, ALL, (140.0, 50.0), STEP), point_probe(GRID, ALL, (140.0, 145.0), STEP)),
    ]
    rng, sigma = np.random.default_rng(1), 1.0 + 0.01 * (X - 100)
    fields = [sigma * point_errors(rng, SHAPE, np.eye(1), SUBSET, STEP, shape_function)[..., 0] for _ in range(1500)]
    for probe in probes:
        found = np.std([value_of(probe, field) for field in fields])
        assert found == pytest.approx(
            sigma_of(probe, sigma, overlap(SUBSET, STEP, shape_function)), rel=4 / np.sqrt(3000)
        )


@pytest.mark.slow
def test_sigma_of_a_mean_strain_is_the_scatter():
    """Strains share their windows' points; the area lies a window away from the edges."""
    rho, rng, fit = overlap(SUBSET, STEP), np.random.default_rng(2), WindowFit((7, 7), 2)
    flat = np.concatenate([GRID, 0 * X[..., None]], axis=-1)
    covariance = np.broadcast_to(1e-4 * np.diag([1.0, 1, 0, 0, 0, 0]), (*SHAPE, 6, 6))
    area = area_probe((abs(X - 137) < 13) & (abs(Y - 97) < 20), ALL)
    means = {"exx": [], "eyy": [], "gxy": []}
    for _ in range(200):
        noisy = flat + point_errors(rng, SHAPE, 1e-4 * np.diag([1.0, 1.0, 0.0]), SUBSET, STEP)
        found = chosen_gradient(measured_surface(flat, noisy, [ErrorShare(covariance, rho)]), [fit]).surface
        change = found.gradient - np.eye(2)
        fields = (change[..., 0, 0], change[..., 1, 1], change[..., 0, 1] + change[..., 1, 0])
        for collected, field in zip(means.values(), fields, strict=True):
            collected.append(value_of(area, field))
    sigma = np.sqrt(np.einsum("...ii->...i", found.covariance))
    shear = np.sqrt(found.covariance[..., 1, 1] + found.covariance[..., 2, 2])
    along = {"exx": [[1, 0]], "eyy": [[0, 1]], "gxy": [[1, 0], [0, 1]]}
    for (name, values), field in zip(means.items(), (sigma[..., 0], sigma[..., 3], shear), strict=True):
        predicted = sigma_of(area, field, strain_correlation(rho, (7, 7), 2, along[name]))
        assert np.std(values) == pytest.approx(predicted, rel=4 / np.sqrt(400))
        assert predicted > 2 * np.sqrt(np.sum((area.weights * field[area.rows, area.cols]) ** 2))


def test_points_of_an_area_are_sampled_evenly():
    area = area_probe(ALL, ALL)
    few = sample_probes(area, 100)
    assert 90 <= len(few) <= 100
    linear = 3.0 * X - 2.0 * Y
    mean = np.mean([value_of(part, linear) for part in few])
    assert mean == pytest.approx(linear.mean(), abs=0.02 * np.ptp(linear))
    assert len(sample_probes(area, 10**6)) == len(area.rows)


@pytest.mark.parametrize(
    "correlation", [overlap(SUBSET, STEP), strain_correlation(overlap(SUBSET, STEP), (5, 5), 1, [[1, 0]])]
)
def test_sigma_over_many_points_is_the_sum_over_all_pairs(correlation):
    rows, cols = np.nonzero(np.add.outer(np.arange(40), np.arange(50)) % 7 > 0)
    sigma, weights = 1e-3 * (1.0 + np.random.default_rng(1).random((40, 50))), np.linspace(-1.0, 2.0, len(rows))
    scaled = weights * sigma[rows, cols]
    expected = scaled @ correlation.at(rows[:, None] - rows, cols[:, None] - cols) @ scaled
    assert sigma_of(Probe(rows, cols, weights), sigma, correlation) == pytest.approx(np.sqrt(expected), rel=1e-9)


def test_the_mean_over_a_whole_grid_has_its_sigma():
    """Of 10⁵ points, whose pairs no memory would hold; they are independent."""
    sigma = np.full((400, 250), 1e-3)
    area = area_probe(sigma > 0, sigma > 0)
    assert sigma_of(area, sigma, independent()) == pytest.approx(1e-3 / np.sqrt(sigma.size), rel=1e-6)


@pytest.mark.parametrize(
    ("shape", "kernel"), [((7, 7), (7, 7)), ((13, 11), (9, 5)), ((5, 3), (12, 13)), ((1, 6), (2, 1))]
)
def test_correlations_are_those_of_scipy(shape, kernel):
    rng = np.random.default_rng(5)
    field, other = rng.standard_normal(shape), rng.standard_normal(kernel)
    np.testing.assert_array_equal(_correlated(field, other), signal.correlate2d(field, other))
    convolved = _correlated(field[::-1, ::-1], other)[::-1, ::-1]
    np.testing.assert_array_equal(convolved, signal.convolve2d(field, other))
    np.testing.assert_allclose(_autocorrelation(field), signal.correlate(field, field), rtol=0.0, atol=1e-12)
