"""The stage correlate with other settings than its own, and with motions far from small, against exact truth."""

import numpy as np
import pytest
from test_correlate_stage import about_middle, error, follow, region, series

from dicflow.core.matching.transform import jacobian
from dicflow.core.status import Status
from dicflow.core.synthetic.planar import planar_pair, translation
from dicflow.core.tensors import congruent

SIZE = (300, 420)
NOISE = 2.0
SHIFT = (0.37, -0.62)


@pytest.fixture(scope="module")
def shifted():
    return planar_pair(SIZE, SHIFT, noise=NOISE, seed=3)


@pytest.mark.parametrize(
    "options",
    [
        {"interpolation": "bicubic"},
        {"interpolation": "bicubic", "shape_function": "quadratic"},
        {"smoothing": 0.8},
        {"gaussian": 8.0},
        {"gaussian": 8.0, "shape_function": "quadratic"},
        {"gaussian": 8.0, "smoothing": 0.8, "interpolation": "bicubic"},
    ],
    ids=lambda options: " ".join(map(str, options.values())),
)
def test_every_setting_meets_the_truth_within_its_sigma(shifted, options):
    level = float(np.hypot(NOISE, 12**-0.5))
    first, found = follow([shifted.reference, shifted.deformed], step_size=16, noise=level, **options)
    had = first["status"] == Status.VALID
    assert (found["status"][had] == Status.VALID).all()
    away = error(first, found, shifted.transform)
    variance = (found["covariance"] + congruent(found["gradient"], found["template"]))[..., [0, 2]]
    assert np.abs(np.nanmean(away, axis=(0, 1))).max() < 4.0 * np.sqrt(np.nanmean(variance) / had.sum()) + 2e-3
    assert np.nanstd(away / np.sqrt(variance)) == pytest.approx(1.0, abs=0.15)


def test_a_gaussian_weight_costs_precision_for_resolution(shifted):
    images = [shifted.reference, shifted.deformed]
    equal, weighted = (follow(images, step_size=16, gaussian=sigma)[1] for sigma in (0.0, 6.0))
    assert np.nanmedian(weighted["covariance"]) > 1.5 * np.nanmedian(equal["covariance"])


def turned(angle_deg):
    angle = np.radians(angle_deg)
    return about_middle([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("transform", "where"),
    [
        (turned(170.0), None),
        (turned(-90.0), None),
        (translation((58.0, 118.5)) @ turned(12.0), [[70, 100], [190, 100], [190, 220], [70, 220]]),
        (about_middle(np.diag([1.0, 1.3])), None),
        (
            translation((-45.5, 104.0)) @ about_middle(np.diag([0.88, 1.3])),
            [[110, 80], [230, 80], [230, 230], [110, 230]],
        ),
    ],
    ids=["170 degrees", "-90 degrees", "132 px", "30 % stretch", "113 px and 30 % stretch"],
)
def test_motions_in_one_step_without_matches(transform, where):
    images = series([np.eye(3), transform])
    steps = follow(images, where and region(where), step_size=14)
    had = steps[0]["status"] == Status.VALID
    assert had.sum() > 30
    assert (steps[1]["status"][had] == Status.VALID).mean() > 0.98
    away = error(steps[0], steps[1], transform)
    assert np.abs(np.nanmean(away, axis=(0, 1))).max() < 5e-3
    assert np.nanstd(away) < 0.03
    places = steps[0]["xy"][had]
    np.testing.assert_allclose(steps[1]["gradient"][had], jacobian(transform, places), atol=0.02)


def perspective(slope):
    """A motion of curvature −2 slope along x."""
    transform = np.eye(3)
    transform[2, 0] = slope
    return about_middle(np.eye(2)) @ transform


@pytest.mark.slow
def test_auto_takes_quadratic_subsets_at_steps_that_need_them():
    """Affine subsets of 31 px have a bias of 0.016 px there, at a σ of 0.01 px."""
    images = series([np.eye(3), np.eye(3), perspective(2e-4), np.eye(3)], noise=3.0)
    steps = follow(images, step_size=10)
    assert [step.attrs["shape_function"] for step in steps] == ["affine", "affine", "quadratic", "affine"]
    assert [step["warp"].shape[-1] for step in steps] == [3, 3, 6, 3]
    away = error(steps[0], steps[2], perspective(2e-4))
    variance = (steps[2]["covariance"] + congruent(steps[2]["gradient"], steps[2]["template_own"]))[..., [0, 2]]
    assert np.abs(np.nanmean(away, axis=(0, 1))).max() < 2e-3
    assert np.nanstd(away / np.sqrt(variance)) == pytest.approx(1.0, abs=0.15)
    assert (steps[2]["bias"][steps[2]["status"] == Status.VALID] < 3e-3).all()


def test_fixed_subsets_say_what_they_leave_out():
    images = series([np.eye(3), perspective(2e-4)], noise=3.0)
    first, found = follow(images, step_size=10, shape_function="affine")
    away = error(first, found, perspective(2e-4))[..., 0]
    assert np.nanmedian(found["bias"][..., 0]) == pytest.approx(abs(np.nanmean(away)), rel=0.2)


@pytest.mark.slow
def test_a_reference_step_of_another_shape():
    """The pattern changes from step to step, and the last motion is curved."""
    transforms = [*(translation((3.0 * k, 1.5 * k)) for k in range(5)), translation((15.0, 7.5)) @ perspective(2e-4)]
    images = series(transforms, changed=[0.0, 0.15, 0.3, 0.45, 0.6, 0.75])
    steps = follow(images, step_size=14)
    last = steps[5]
    assert last.attrs["shape_function"] == "quadratic"
    chained = last["way"] == 2
    assert chained.sum() > 0.9 * (steps[0]["status"] == Status.VALID).sum()
    assert np.abs(np.nanmean(error(steps[0], last, transforms[5])[chained], axis=0)).max() < 0.05
