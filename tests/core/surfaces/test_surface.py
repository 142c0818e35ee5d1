import os
import subprocess
import sys
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.core.surfaces.surface import choose_degree, evaluate, fit_lowess, fit_surface, polynomial_terms, quality

ROWS, COLS = 90, 70
ROW, COL = np.mgrid[:ROWS, :COLS].astype(float)


def bowl(noise=0.0, seed=0, blur=0.0):
    """A quadratic surface in mm at the distance of a camera's specimen, with noise (correlated if blurred)."""
    u, v = COL / COLS - 0.5, ROW / ROWS - 0.5
    truth = 600.0 + 4.0 * u - 2.0 * v + 3.0 * u**2 + u * v - 1.5 * v**2
    error = np.random.default_rng(seed).normal(size=truth.shape)
    if blur:
        error = cv2.GaussianBlur(error, (0, 0), blur)
    return truth, truth + noise * error / error.std()


@pytest.mark.parametrize(("degree", "count"), [((1, 1), 3), ((2, 2), 6), ((3, 3), 10), ((3, 2), 9), ((5, 5), 21)])
def test_number_of_terms(degree, count):
    assert polynomial_terms(degree).sum() == count


@given(p=st.integers(0, 5), q=st.integers(0, 5), seed=st.integers(0, 10_000))
@settings(max_examples=30)
def test_perfect_polynomial(p, q, seed):
    rng = np.random.default_rng(seed)
    coefficients = np.where(polynomial_terms((p, q)), rng.normal(size=(p + 1, q + 1)), 0.0)
    truth = np.polynomial.polynomial.polyval2d(COL / 35 - 1, ROW / 45 - 1, coefficients) + 500.0
    holed = np.where(rng.random(truth.shape) < 0.3, np.nan, truth)
    for robust in ("none", "bisquare", "lar"):
        surface = fit_surface(holed, (p, q), robust)
        assert np.abs(evaluate(surface, np.arange(COLS), np.arange(ROWS)) - truth).max() < 1e-8
        assert surface.quality.rmse < 1e-8


def test_fit_agrees_with_plain_least_squares():
    _, field = bowl(noise=0.2)
    surface = fit_surface(field, (3, 3))
    design = np.stack([COL.ravel() ** i * ROW.ravel() ** j / 50.0 ** (i + j) for i, j in
                       [(i, j) for i in range(4) for j in range(4) if i + j <= 3]], axis=1)  # fmt: skip
    fitted = design @ np.linalg.lstsq(design, field.ravel(), rcond=None)[0]
    assert np.abs(evaluate(surface, np.arange(COLS), np.arange(ROWS)).ravel() - fitted).max() < 1e-8
    assert surface.quality.sse == pytest.approx(((field.ravel() - fitted) ** 2).sum(), rel=1e-9)


@given(seed=st.integers(0, 10_000), holes=st.floats(0.0, 0.8), noise=st.floats(1e-3, 10.0))
@settings(max_examples=30)
def test_sse_never_grows_with_the_degree(seed, holes, noise):
    _, field = bowl(noise, seed)
    field[np.random.default_rng(seed + 1).random(field.shape) < holes] = np.nan
    errors = [fit_surface(field, (d, d)).quality.sse for d in range(6)]
    assert all(higher <= lower * (1 + 1e-12) for lower, higher in pairwise(errors))


def test_noisy_sse_is_that_of_the_freedom_left():
    """SSE / σ² has the mean n − p and the deviation √(2 (n − p))."""
    _, field = bowl(noise=0.25)
    fit = fit_surface(field, (2, 2)).quality
    freedom = field.size - 6
    assert fit.sse / 0.25**2 == pytest.approx(freedom, abs=4 * np.sqrt(2 * freedom))
    assert fit.rmse == pytest.approx(np.sqrt(fit.sse / freedom))


def test_r2_of_least_squares_is_one_less_the_unexplained():
    _, field = bowl(noise=0.4)
    fit = fit_surface(field, (2, 2)).quality
    total = ((field - field.mean()) ** 2).sum()
    assert fit.r2 == pytest.approx(1 - fit.sse / total, rel=1e-9)
    assert fit.adjusted_r2 == pytest.approx(1 - (fit.sse / (field.size - 6)) / (total / (field.size - 1)))


def test_quality_of_a_constant():
    assert quality(np.ones((4, 4)), np.ones((4, 4)), np.ones((4, 4)), 1) == (0.0, 1.0, 1.0, 0.0)


@pytest.mark.parametrize("robust", ["bisquare", "lar"])
def test_outliers_do_not_move_a_robust_surface(robust):
    """A fifth of the points is 40 σ off on one side; the surface stays within 5 of its own standard errors."""
    truth, field = bowl(noise=0.1)
    wrong = np.random.default_rng(9).random(field.shape) < 0.2
    field[wrong] += 4.0
    surface = fit_surface(field, (2, 2), robust)
    error = evaluate(surface, np.arange(COLS), np.arange(ROWS)) - truth
    assert surface.converged
    bias = {"bisquare": 0.0, "lar": 0.1 * 0.319}[robust]  # the median of 80 % sound values: Φ⁻¹(0.5 / 0.8) = 0.319
    assert np.sqrt(np.mean((error - bias) ** 2)) < 5 * 0.1 * np.sqrt(6 / (0.6 * field.size))
    plain = evaluate(fit_surface(field, (2, 2)), np.arange(COLS), np.arange(ROWS)) - truth
    assert np.abs(plain).mean() > 0.7
    assert robust == "lar" or np.all(surface.weights[wrong] == 0.0)


def test_bisquare_keeps_95_percent_efficiency():
    """On normal noise the weights take off little: Var(robust) / Var(plain) = 1 / 0.95 (Holland & Welsch 1977)."""
    constants = [
        [float(evaluate(fit_surface(field, (0, 0), robust), [0], [0])[0, 0]) for robust in ("none", "bisquare")]
        for field in np.random.default_rng(0).normal(size=(600, 15, 15))
    ]
    plain, robust = np.var(constants, axis=0)
    assert plain / robust == pytest.approx(0.95, abs=0.04)


def test_rmse_of_a_bisquare_fit_reads_low():
    """√(∫ w r² φ / ∫ w φ) = 0.910 with the weights of bisquare and the normal density φ."""
    _, field = bowl(noise=0.25)
    assert fit_surface(field, (2, 2), "bisquare").quality.rmse == pytest.approx(0.910 * 0.25, rel=0.03)


def test_lar_of_a_constant_is_the_median():
    field = np.random.default_rng(4).exponential(size=(60, 50))
    surface = fit_surface(field, (0, 0), "lar")
    assert evaluate(surface, [0], [0])[0, 0] == pytest.approx(np.median(field), abs=0.01)
    assert surface.weights.mean() == pytest.approx(1.0)


def test_a_subset_judges_outliers_nearly_alike():
    _, field = bowl(noise=0.1)
    field[20:30, 20:40] += 5.0
    whole, subset = (fit_surface(field, (2, 2), "bisquare", n) for n in (200_000, 1000))
    error = evaluate(subset, np.arange(COLS), np.arange(ROWS)) - evaluate(whole, np.arange(COLS), np.arange(ROWS))
    assert 0.0 < np.abs(error).max() < 0.02
    assert np.all(subset.weights[20:30, 20:40] == 0.0)


def test_a_fit_on_half_the_crop_uses_its_own_frame():
    truth, field = bowl()
    field[:, :40] = np.nan
    surface = fit_surface(field, (2, 2))
    assert surface.centre == (54.5, 44.5)
    assert surface.half == (14.5, 44.5)
    assert np.abs(evaluate(surface, np.arange(COLS), np.arange(ROWS)) - truth).max() < 1e-8


def test_too_few_points_are_refused():
    field = np.full((9, 9), np.nan)
    field[2, 2:5] = 1.0
    with pytest.raises(ValueError, match="6 coefficients, but only 3 points"):
        fit_surface(field, (2, 2))


@pytest.mark.parametrize("blur", [0.0, 2.0])
@pytest.mark.parametrize("robust", ["none", "bisquare"])
def test_choice_finds_the_degree_for_any_correlation_length_of_the_noise(blur, robust):
    chosen = [choose_degree(bowl(noise=0.1, seed=seed, blur=blur)[1], robust).degree for seed in range(8)]
    assert chosen.count(2) >= 7


def test_choice_gives_its_reason():
    choice = choose_degree(bowl(noise=0.1, blur=2.0)[1])
    assert choice.reason.startswith("degree 2 of 1…5 has the lowest BIC with")
    area = float(choice.reason.split("correlated over ")[1].split()[0])
    assert area == pytest.approx(4 * np.pi * 2.0**2, rel=0.35)  # ∬ ρ of Gaussian smoothing: 4 π s²


def test_choice_for_exact_data():
    assert choose_degree(bowl()[0]).degree == 2


def test_choice_does_not_stop_before_an_even_higher_term():
    field = 600 + (COL / 35 - 1) ** 4 + np.random.default_rng(0).normal(0, 0.01, COL.shape)
    assert choose_degree(field).degree == 4


@pytest.mark.parametrize("degree", [1, 2])
def test_lowess_reproduces_its_own_degree(degree):
    truth = 500 + 0.1 * COL - 0.2 * ROW + (degree - 1) * 0.01 * COL * ROW
    holed = truth.copy()
    holed[30:40, 20:30] = np.nan
    smooth = fit_lowess(holed, (25, 25), degree)
    assert np.abs(smooth.values - truth).max() < 1e-8


def test_lowess_keeps_a_spike_out_when_robust():
    truth, field = bowl(noise=0.05)
    field[45, 35] += 50.0
    plain, robust = (fit_lowess(field, (21, 21), 2, kind) for kind in ("none", "bisquare"))
    assert abs(plain.values[45, 35] - truth[45, 35]) > 0.5
    assert abs(robust.values[45, 35] - truth[45, 35]) < 0.05
    assert robust.weights[45, 35] == 0.0


def test_lowess_rmse_is_the_noise():
    _, field = bowl(noise=0.2)
    fit = fit_lowess(field, (31, 31), 2).quality
    assert fit.rmse == pytest.approx(0.2, rel=0.03)


def test_lowess_without_points_is_refused():
    with pytest.raises(ValueError, match="no window of 21 × 21 holds enough points"):
        fit_lowess(np.full((30, 30), np.nan), (21, 21), 1, "bisquare")


@pytest.mark.slow
def test_the_number_of_threads_of_linear_algebra_changes_no_bit():
    """Products are made again in other processes, and must come out the same."""
    code = """
import numpy as np
from dicflow.core.surfaces.surface import fit_surface
field = np.random.default_rng(0).normal(400.0, 1.0, (1300, 420))
surface = fit_surface(field, (3, 3), "bisquare")
print(surface.coefficients.tobytes().hex(), surface.quality)
"""
    said = [
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "OPENBLAS_NUM_THREADS": threads},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for threads in ("1", "2")
    ]
    assert said[0] == said[1]
