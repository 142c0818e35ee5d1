import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from dicflow.core.correlation.subsets import Subset, correlate, describe
from dicflow.core.correlation.template import template
from dicflow.core.correlation.warp import TERMS, apply_warp, gradient, identity, recentred
from dicflow.core.photographs.interpolate import slopes, spline
from dicflow.core.status import Status
from dicflow.core.synthetic.motion import reference_points, render_pattern, speckle_pattern
from tests.scenes import texture

SIDE = 121
MIDDLE = np.array([60.0, 60.0])
CENTRES = np.stack(np.meshgrid([40, 60, 75], [45, 60, 80]), axis=-1).reshape(-1, 2).astype(float)

SHIFT = np.array([[63.3, 1, 0], [58.6, 0, 1]])
AFFINE = np.array([[61.2, 1.05, 0.03], [59.7, -0.04, 0.96]])
ROTATION = np.array([[60.0, np.cos(0.3), -np.sin(0.3)], [60.0, np.sin(0.3), np.cos(0.3)]])
QUADRATIC = np.array([[61.2, 1.02, 0.03, 4e-4, -3e-4, 2e-4], [59.7, -0.02, 0.97, 2e-4, 3e-4, -4e-4]])

both = pytest.mark.parametrize("shape_function", ["affine", "quadratic"])


@cache
def pixels(side=SIDE):
    return np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).astype(float)


def photograph(warp=None, side=SIDE):
    """Grey levels of a texture, not rounded; carried by a warp about the middle of the picture."""
    points = pixels(side)
    if warp is not None:
        middle = np.array([side // 2, side // 2])
        points = reference_points(lambda p: (apply_warp(warp, p - middle), gradient(warp, p - middle)), points)
    return texture(points[..., 0], points[..., 1], 6.0)


def expected_warps(warp, shape_function, centres=CENTRES):
    warps = np.zeros((len(centres), 2, TERMS[shape_function]))
    at = recentred(warp, centres - MIDDLE)
    warps[..., : at.shape[-1]] = at
    return warps


def nearby(warps, by=(0.4, -0.3)):
    start = warps.copy()
    start[..., 0] += by
    return start


REFERENCE = template(spline(photograph()))
EXACT = Subset(31, tolerance_px=1e-6)


@both
@pytest.mark.parametrize("degree", [3, 5])
def test_nothing_moves_between_equal_images(shape_function, degree):
    image, warps = photograph(), identity(CENTRES, shape_function)
    found = correlate(
        template(spline(image, degree)),
        spline(image, degree),
        CENTRES,
        nearby(warps),
        EXACT._replace(shape_function=shape_function),
    )
    np.testing.assert_allclose(found.warp, warps, atol=2e-5)
    assert (found.status == Status.VALID).all()
    assert np.abs(found.znssd).max() < 1e-6


@both
@pytest.mark.parametrize("gaussian", [0.0, 7.0])
def test_a_subset_described_is_one_found_in_its_own_photograph(shape_function, gaussian):
    """Also where the region cuts it or a pixel is not measured; texture that is plain or hidden has its reason."""
    image, region, measured = photograph(), np.ones((SIDE, SIDE), dtype=bool), np.ones((SIDE, SIDE), dtype=bool)
    image[:40, 86:] = 80.0
    region[:, 88:] = False
    region[:35] = True
    measured[58:63, 58:63] = False
    measured[90:, :40] = False
    centres = np.array([[60.0, 60.0], [85.0, 80.0], [75.0, 45.0], [104.0, 16.0], [20.0, 105.0], [112.0, 80.0]])
    itself, subset = spline(image, 5, measured), Subset(31, shape_function, gaussian)
    reference = template(itself, region)
    found = correlate(reference, itself, centres, identity(centres, shape_function), subset)
    described = describe(reference, measured, centres, subset)
    expected = [Status.VALID, Status.VALID, Status.VALID, Status.LOW_TEXTURE, Status.OVEREXPOSED, Status.CUT_SUBSET]
    assert described.status.tolist() == found.status.tolist() == expected
    np.testing.assert_allclose(described.covariance, found.covariance, rtol=1e-5, atol=1e-11)
    np.testing.assert_allclose(described.texture, found.texture, rtol=1e-6)
    np.testing.assert_array_equal(described.warp[:3], identity(centres[:3], shape_function))
    assert np.isnan(described.warp[3:]).all()
    np.testing.assert_array_equal(
        describe(reference, measured, centres, subset, threads=2).covariance, described.covariance
    )


@pytest.mark.parametrize("size", [21, 31])
@pytest.mark.parametrize(
    ("warp", "shape_function"),
    [(SHIFT, "affine"), (AFFINE, "affine"), (ROTATION, "affine"), (AFFINE, "quadratic"), (QUADRATIC, "quadratic")],
    ids=["shift", "affine", "rotation", "affine by quadratic", "quadratic"],
)
def test_perfect_motions_are_recovered(warp, shape_function, size):
    expected = expected_warps(warp, shape_function)
    subset = EXACT._replace(size=size, shape_function=shape_function)
    found = correlate(REFERENCE, spline(photograph(warp)), CENTRES, nearby(expected), subset)
    assert (found.status == Status.VALID).all()
    error = np.abs(found.warp - expected).max(axis=(0, 1))
    assert (error < [3e-5, 5e-6, 5e-6, 1e-6, 1e-6, 1e-6][: error.size]).all()


def test_a_shift_of_several_pixels_is_found():
    found = correlate(REFERENCE, spline(photograph(SHIFT)), CENTRES, identity(CENTRES), EXACT)
    np.testing.assert_allclose(found.warp, expected_warps(SHIFT, "affine"), atol=3e-5)


@both
def test_brightness_and_contrast_do_not_matter(shape_function):
    warp, subset = QUADRATIC, EXACT._replace(shape_function=shape_function)
    start, image = nearby(expected_warps(warp, "quadratic")[..., : TERMS[shape_function]]), photograph(warp)
    plain, darker = (correlate(REFERENCE, spline(grey), CENTRES, start, subset) for grey in (image, 0.4 * image + 17))
    np.testing.assert_allclose(darker.warp, plain.warp, atol=5e-6)
    np.testing.assert_allclose(darker.znssd, plain.znssd, atol=1e-5)
    assert np.abs(darker.iterations - plain.iterations).max() <= 1  # the last increment is at the tolerance


@pytest.mark.parametrize("gaussian", [0.0, 6.0])
@pytest.mark.parametrize("size", [15, 21, 31])
def test_an_affine_subset_averages_what_it_cannot_follow(size, gaussian):
    # x = ξ + c ξ²: the best shift is the mean of c ξ² over the subset
    bent, offset = np.array([[60.0, 1, 0, 5e-4, 0, 0], [60.0, 0, 1, 0, 0, 0]]), np.arange(size) - size // 2
    weight = np.exp(-0.5 * (offset / gaussian) ** 2) if gaussian else np.ones(size)
    theory = 5e-4 * np.average(offset**2.0, weights=weight)
    centres = np.stack(np.meshgrid(np.arange(30, 91, 6), np.arange(30, 91, 6)), axis=-1).reshape(-1, 2).astype(float)
    truth = apply_warp(bent, centres - MIDDLE)
    start = np.ascontiguousarray(expected_warps(bent, "quadratic", centres)[..., :3])
    found = correlate(REFERENCE, spline(photograph(bent)), centres, start, EXACT._replace(size=size, gaussian=gaussian))
    error = (found.warp[..., 0] - truth).mean(axis=0)
    assert error == pytest.approx([theory, 0.0], abs=0.05 * theory)


def test_the_last_increments_shrink_to_the_tolerance():
    noisy = spline(photograph(AFFINE) + np.random.default_rng(0).normal(0, 4, (SIDE, SIDE)))
    start = nearby(expected_warps(AFFINE, "affine"), (0.7, -0.6))
    best = correlate(REFERENCE, noisy, CENTRES, start, EXACT).warp[..., 0]
    iterations = []
    for tolerance in (1e-1, 1e-2, 1e-3, 1e-4):
        found = correlate(REFERENCE, noisy, CENTRES, start, EXACT._replace(tolerance_px=tolerance))
        assert np.abs(found.warp[..., 0] - best).max() < tolerance
        iterations.append(int(found.iterations.max()))
    assert iterations[-1] <= iterations[0] + 3


@both
def test_a_region_of_the_whole_image_changes_nothing(shape_function):
    subset = EXACT._replace(shape_function=shape_function)
    target, start = spline(photograph(AFFINE)), nearby(expected_warps(AFFINE, shape_function))
    masked = template(spline(photograph()), np.ones((SIDE, SIDE), dtype=bool))
    for one, other in zip(
        correlate(REFERENCE, target, CENTRES, start, subset),
        correlate(masked, target, CENTRES, start, subset),
        strict=True,
    ):
        np.testing.assert_array_equal(one, other)


@both
@pytest.mark.parametrize("columns_left", [12, 16, 22, 30])
def test_a_subset_cut_by_the_region_uses_what_is_inside(shape_function, columns_left):
    usable, centre = np.zeros((SIDE, SIDE), dtype=bool), MIDDLE[None]
    usable[:, 45 : 45 + columns_left] = True  # the subset's columns are 45 to 75
    expected = expected_warps(AFFINE, shape_function, centre)
    target = photograph(AFFINE)
    subset = Subset(31, shape_function, min_share=columns_left / 31 - 1e-9, tolerance_px=1e-4)
    reference = template(spline(photograph()), usable)
    found = correlate(reference, spline(target), centre, nearby(expected), subset)
    assert found.status[0] == Status.VALID
    np.testing.assert_allclose(found.warp[0, :, 0], expected[0, :, 0], atol=5e-4)
    assert found.covariance[0, 0] > correlate(REFERENCE, spline(target), centre, expected, subset).covariance[0, 0]
    more = subset._replace(min_share=columns_left / 31 + 1e-9)
    refused = correlate(reference, spline(target), centre, nearby(expected), more)
    assert refused.status[0] == Status.CUT_SUBSET
    assert np.isnan(refused.warp).all()


def test_pixels_outside_the_region_are_not_used():
    usable = np.zeros((SIDE, SIDE), dtype=bool)
    usable[:, :64] = True
    images, rng = [photograph(), photograph(SHIFT)], np.random.default_rng(1)
    for image, edge in zip(images, (70, 73), strict=True):  # a few pixels aside, as splines and derivatives reach there
        image[:, edge:] = rng.uniform(0, 255, image[:, edge:].shape)
    found = correlate(
        template(spline(images[0]), usable), spline(images[1]), MIDDLE[None], identity(MIDDLE[None]), EXACT
    )
    np.testing.assert_allclose(found.warp[0, :, 0], SHIFT[:, 0], atol=1e-3)


@pytest.mark.parametrize("corner", [(0, 60), (60, 120), (120, 60), (60, 0)])
def test_a_subset_at_the_edge_of_the_photograph_is_cut(corner):
    # the target shows a pixel more on every side, so that nothing of the subset leaves it
    target = photograph(np.array([[60.4, 0.98, 0], [59.7, 0, 0.98]]))
    expected = expected_warps(np.array([[60.4, 0.98, 0], [59.7, 0, 0.98]]), "affine", np.array([corner], dtype=float))
    subset = EXACT._replace(min_share=16 / 31 - 1e-9)
    found = correlate(REFERENCE, spline(target), np.array([corner]), expected, subset)
    assert found.status[0] == Status.VALID
    np.testing.assert_allclose(found.warp, expected, atol=0.01)


def test_points_without_a_start_stay_untracked():
    start = nearby(expected_warps(AFFINE, "affine"))
    start[2, 1, 0], start[5] = np.nan, np.nan
    target = spline(photograph(AFFINE))
    found = correlate(REFERENCE, target, CENTRES, start, EXACT)
    assert np.flatnonzero(found.status == Status.UNTRACKED).tolist() == [2, 5]
    assert np.isnan(found.warp[[2, 5]]).all()
    assert (found.iterations[[2, 5]] == 0).all()
    alone = correlate(REFERENCE, target, CENTRES[[0]], start[[0]], EXACT)
    np.testing.assert_array_equal(alone.warp[0], found.warp[0])


@pytest.mark.parametrize("kind", ["plain", "stripes", "ramp"])
@both
def test_status_of_a_subset_without_texture(kind, shape_function):
    x = pixels()[..., 0]
    image = {"plain": 0 * x + 80, "stripes": 100 + 50 * np.cos(x), "ramp": x}[kind]
    start = identity(CENTRES, shape_function)
    found = correlate(template(spline(image)), spline(image), CENTRES, start, Subset(shape_function=shape_function))
    assert (found.status == Status.LOW_TEXTURE).all()
    assert np.isnan(found.warp).all()
    assert np.isnan(found.covariance).all()


@pytest.mark.parametrize("place", [(-30.0, 60.0), (60.0, 1e9), (5.0, 60.0), (60.0, 115.0)])
def test_a_subset_that_leaves_the_target(place):
    start = identity(CENTRES[:1])
    start[0, :, 0] = place
    found = correlate(REFERENCE, spline(photograph()), CENTRES[:1], start, EXACT)
    assert found.status[0] == Status.OUTSIDE
    assert np.isnan(found.warp).all()


def test_too_few_iterations():
    start = nearby(expected_warps(AFFINE, "affine"))
    found = correlate(REFERENCE, spline(photograph(AFFINE)), CENTRES, start, EXACT._replace(iterations=2))
    assert (found.status == Status.NOT_CONVERGED).all()
    assert (found.iterations == 2).all()
    assert np.isnan(found.warp).all()


def test_a_plain_target_is_no_match():
    found = correlate(REFERENCE, spline(np.full((SIDE, SIDE), 80.0)), CENTRES, identity(CENTRES), EXACT)
    assert (found.status == Status.NOT_CONVERGED).all()
    assert np.isnan(found.warp).all()


def test_no_points_at_all():
    found = correlate(REFERENCE, spline(photograph()), np.empty((0, 2)), np.empty((0, 2, 3)), EXACT)
    assert [len(part) for part in found] == [0] * 7


@pytest.mark.parametrize(
    ("subset", "match"), [(Subset(30), "odd"), (Subset(3), "at least 5"), (Subset(31, "quadratic"), "quadratic warps")]
)
def test_invalid_settings(subset, match):
    with pytest.raises(ValueError, match=match):
        correlate(REFERENCE, spline(photograph()), CENTRES, identity(CENTRES), subset)


@both
def test_threads_give_the_same_bytes(shape_function):
    centres = np.stack(np.meshgrid(np.arange(20, 100, 2), np.arange(20, 100, 2)), axis=-1).reshape(-1, 2).astype(float)
    start = expected_warps(AFFINE, shape_function, centres)
    start[::7] = np.nan
    subset = Subset(21, shape_function)
    target = spline(photograph(AFFINE) + np.random.default_rng(0).normal(0, 3, (SIDE, SIDE)))
    one, two = (correlate(REFERENCE, target, centres, start, subset, threads) for threads in (1, 2))
    assert len(centres) > 1024
    for alone, shared in zip(one, two, strict=True):
        assert alone.tobytes() == shared.tobytes()


@both
def test_covariance_turns_with_the_target(shape_function):
    # seen by a camera turned by 90°, x is where y was
    turned = np.array([[60.0, 0, 1], [60.0, -1, 0]])
    subset = EXACT._replace(shape_function=shape_function)
    straight = correlate(REFERENCE, spline(photograph()), CENTRES, identity(CENTRES, shape_function), subset)
    found = correlate(REFERENCE, spline(photograph(turned)), CENTRES, expected_warps(turned, shape_function), subset)
    np.testing.assert_allclose(found.covariance, straight.covariance[:, [2, 1, 0]] * [1, -1, 1], rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("shift", [0.1, 0.25, 0.4, 0.5, 0.7, 0.85])
def test_no_bias_at_any_fraction_of_a_pixel(shift):
    centres = np.stack(np.meshgrid(np.arange(24, 178, 7), np.arange(24, 178, 7)), axis=-1).reshape(-1, 2).astype(float)
    found = correlate(template(spline(speckles(0.0))), spline(speckles(shift)), centres, identity(centres), Subset(31))
    bias = (found.warp[..., 0] - centres).mean(axis=0) - [shift, -0.5 * shift]
    assert np.abs(bias).max() < 5e-4


@cache
def speckles(shift, side=201):
    """Soft speckles, integrated over pixels and not rounded."""
    pattern = speckle_pattern((side, side), (4.0, 8.0), 3.0, 0.5, seed=3)
    by = np.array([shift, -0.5 * shift])
    return render_pattern(
        pattern, (side, side), lambda points: (points + by, np.broadcast_to(np.eye(2), (*points.shape, 2))), order=5
    )


NOISE = 2.0


@cache
def noisy_errors(shape_function, gaussian, size=21, images=24):
    """Errors (n, 2) [px] and reported covariance (n, 3) [px²] of separate subsets in pairs of noisy images."""
    centres = (
        np.stack(np.meshgrid(np.arange(15, 190, 21), np.arange(15, 190, 21)), axis=-1).reshape(-1, 2).astype(float)
    )
    shift = np.array([[100.3, 1, 0], [99.8, 0, 1]])
    clean, rng = (photograph(side=201), photograph(shift, side=201)), np.random.default_rng(7)
    errors, covariances = [], []
    for _ in range(images):
        reference, target = (spline(image + rng.normal(0, NOISE, image.shape)) for image in clean)
        subset = Subset(size, shape_function, gaussian)
        found = correlate(template(reference), target, centres, identity(centres, shape_function), subset)
        errors.append(found.warp[..., 0] - centres - [0.3, -0.2])
        covariances.append(found.covariance * NOISE**2)
    return np.concatenate(errors), np.concatenate(covariances)


weighted = pytest.mark.parametrize(
    ("shape_function", "gaussian"), [("affine", 0), ("quadratic", 0), ("affine", 5), ("quadratic", 5)]
)


@weighted
def test_scatter_is_the_reported_covariance(shape_function, gaussian):
    error, covariance = noisy_errors(shape_function, gaussian)
    assert (error**2).mean(axis=0) == pytest.approx(covariance[:, [0, 2]].mean(axis=0), rel=0.2)  # 10 % of σ
    scale = covariance[:, [0, 2]].mean()
    assert error.prod(axis=1).mean() / scale == pytest.approx(covariance[:, 1].mean() / scale, abs=0.08)


@weighted
def test_coverage_of_one_and_two_sigma(shape_function, gaussian):
    error, covariance = noisy_errors(shape_function, gaussian)
    scaled = np.abs(error) / np.sqrt(covariance[:, [0, 2]])
    assert (scaled < 1).mean() == pytest.approx(0.683, abs=0.03)
    assert (scaled < 2).mean() == pytest.approx(0.954, abs=0.02)


@both
@pytest.mark.parametrize("gaussian", [0.0, 4.0, 8.0])
def test_the_covariance_is_that_of_weighted_least_squares(shape_function, gaussian):
    """2 H⁻¹ V H⁻¹ in double precision, for warp and light together, one point at a time."""
    subset, half = Subset(31, shape_function, gaussian), 15
    reference = template(spline(photograph()))
    offset = np.arange(-half, half + 1) / half
    xi, eta = (part.ravel() for part in np.meshgrid(offset, offset))
    monomials = np.stack([np.ones_like(xi), xi, eta, xi**2, xi * eta, eta**2][: TERMS[shape_function]])
    weight = np.exp(-0.5 * (xi**2 + eta**2) * (half / gaussian) ** 2) if gaussian else np.ones_like(xi)
    found = correlate(reference, spline(photograph()), CENTRES, identity(CENTRES, shape_function), subset)
    for (x, y), covariance in zip(CENTRES.astype(int), found.covariance, strict=True):
        part = np.s_[y - half : y + half + 1, x - half : x + half + 1]
        f, fx, fy = (image[part].ravel().astype(float) for image in (reference.grey, reference.by_x, reference.by_y))
        model = np.concatenate([fx * monomials, fy * monomials, [np.ones_like(f), f - f.mean()]])
        inverse = np.linalg.inv(model * weight @ model.T)
        exact = 2.0 * inverse @ (model * weight**2 @ model.T) @ inverse
        terms = len(monomials)
        np.testing.assert_allclose(covariance, [exact[0, 0], exact[0, terms], exact[terms, terms]], rtol=2e-3)


def test_scatter_of_an_affine_subset_is_the_theoretical_one():
    # Pan et al. 2008: σ_u = √2 σ/√Σ g_x²
    pattern, rng = speckle_pattern((201, 201), (2.8, 4.8), 2.8, 0.5, seed=2), np.random.default_rng(3)
    image, rows = render_pattern(pattern, (201, 201)), np.arange(20, 190, 32)
    centres = np.stack(np.meshgrid(rows, rows), axis=-1).reshape(-1, 2).astype(float)
    errors = []
    for _ in range(30):
        pair = (spline(image + rng.normal(0, NOISE, image.shape)) for _ in range(2))
        errors.append(correlate(template(next(pair)), next(pair), centres, identity(centres)).warp[..., 0] - centres)
    for axis, slope in enumerate(slopes(spline(image))):
        squares = [(slope[y - 15 : y + 16, x - 15 : x + 16] ** 2).sum() for x, y in centres.astype(int)]
        theory = np.sqrt(np.mean(2 * NOISE**2 / np.array(squares)))
        assert np.std(np.array(errors)[..., axis]) == pytest.approx(theory, rel=0.1)


PLAIN = """
import sys
import numpy as np
from dicflow.core.correlation.subsets import Subset, correlate
from dicflow.core.correlation.template import template
from dicflow.core.photographs.interpolate import spline
given = np.load(sys.argv[1])
for name, degree in (("affine", 5), ("affine", 3), ("quadratic", 5)):
    subset = Subset(11, name, tolerance_px=1e-4)
    start = np.zeros((2, 2, 3 if name == "affine" else 6))
    start[..., :3] = given["start"]
    images = (spline(given[key], degree) for key in ("reference", "target"))
    found = correlate(template(next(images), given["usable"]), next(images), given["centres"], start, subset)
    print(*found.warp.ravel(), *found.znssd, *found.covariance.ravel(), *found.iterations, *found.status)
"""


@pytest.mark.slow
def test_plain_python_gives_the_compiled_result(tmp_path):
    warp = np.array([[60.3, 1.02, 0.01], [60.2, -0.02, 0.99]])
    images = {"reference": photograph()[42:79, 42:79], "target": photograph(warp)[42:79, 42:79]}
    centres, usable = np.array([[18.0, 17.0], [12.0, 20.0]]), np.ones((37, 37), dtype=bool)
    usable[:, :10] = False  # cuts the second subset
    np.savez(tmp_path / "given.npz", centres=centres, start=identity(centres), usable=usable, **images)
    results = []
    for disable in ("0", "1"):
        command = [sys.executable, "-c", PLAIN, tmp_path / "given.npz"]
        environment = {**os.environ, "NUMBA_DISABLE_JIT": disable}
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2]
        )
        results.append([np.array(line.split(), dtype=float) for line in done.stdout.splitlines()])
    for compiled, plain in zip(*results, strict=True):
        assert np.isfinite(compiled).all()
        np.testing.assert_allclose(plain, compiled, atol=1e-5)
