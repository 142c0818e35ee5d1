"""Blur of the target against the template: its size, its direction, and what it does to the noise."""

import cv2
import numpy as np
import pytest

from dicflow.core.correlation.blur import _further_blurs, equally_sharp
from dicflow.core.photographs.interpolate import spline

SIDE = 420
EVERYWHERE = np.ones((SIDE, SIDE), dtype=bool)
PLACES = np.stack(np.meshgrid(*[np.arange(60.0, 361.0, 20.0)] * 2), axis=-1).reshape(-1, 2)


def pattern(seed=0):
    grey = np.random.default_rng(seed).normal(size=(SIDE, SIDE))
    return np.asarray(128.0 + 900.0 * cv2.GaussianBlur(grey, (0, 0), 2.0) * 0.3, dtype=np.float32)


def noisy(grey, seed):
    """A photograph with noise of one grey level."""
    return np.asarray(grey + np.random.default_rng(seed).normal(size=grey.shape), dtype=np.float32)


def warps(gradient):
    """Of the places, about the middle, by a gradient."""
    middle = 0.5 * (SIDE - 1)
    moved = middle + (PLACES - middle) @ gradient.T
    return np.concatenate([moved[..., None], np.broadcast_to(gradient, (len(PLACES), 2, 2))], axis=-1)


@pytest.mark.parametrize("sigma", [1.5, 3.0, 4.5])
def test_the_whole_blur_is_found(sigma):
    """One estimate alone finds three quarters of the largest, since windows flatten steep spectra."""
    target = spline(noisy(cv2.GaussianBlur(pattern(), (0, 0), sigma), 2))
    _, same, damping = equally_sharp(noisy(pattern(), 1), EVERYWHERE, target, PLACES, warps(np.eye(2)), 0.0)
    assert damping.blur == pytest.approx(sigma**2, rel=0.05)
    assert damping.mixing == pytest.approx(sigma, rel=0.03)
    assert same is target


def test_a_blur_of_a_stretched_photograph_is_narrower_along_the_stretch():
    """The template shows it in its own pixels, of which the stretched photograph has more."""
    gradient = np.diag([1.5, 1.0])
    middle = 0.5 * (SIDE - 1)
    stretch = np.array([[1.5, 0.0, middle - 1.5 * middle], [0.0, 1.0, 0.0]])
    seen = cv2.warpAffine(pattern(), stretch, (SIDE, SIDE), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    sigma = 3.0
    target = spline(noisy(cv2.GaussianBlur(seen, (0, 0), sigma), 2))
    near = np.abs(warps(gradient)[..., 0] - middle).max(axis=1) < 150.0
    soft, _, _ = equally_sharp(noisy(pattern(), 1), EVERYWHERE, target, PLACES[near], warps(gradient)[near], 0.0)
    expected = cv2.GaussianBlur(pattern(), (0, 0), sigmaX=sigma / 1.5, sigmaY=sigma)
    inside = np.s_[120:-120, 120:-120]
    assert np.std((soft - expected)[inside]) < 0.1 * np.std(expected[inside])


def test_motion_during_the_exposure_blurs_along_its_direction():
    """The template is blurred along it, and hardly across."""
    way = np.array([0.8, 0.6])
    trace = np.zeros((15, 15))
    for share in np.linspace(-0.5, 0.5, 201):
        x, y = 7.0 + 6.0 * share * way
        i, j = int(y), int(x)
        trace[i : i + 2, j : j + 2] += np.outer([1.0 - y + i, y - i], [1.0 - x + j, x - j])
    trace /= trace.sum()
    target = spline(noisy(cv2.filter2D(pattern(), -1, trace), 2))
    soft, same, damping = equally_sharp(noisy(pattern(), 1), EVERYWHERE, target, PLACES, warps(np.eye(2)), 0.0)
    expected, inside = cv2.filter2D(pattern(), -1, trace), np.s_[60:-60, 60:-60]
    assert same is target
    spread = sum((trace.sum(axis=k) * (np.arange(15) - 7.0) ** 2).sum() for k in (0, 1))
    assert damping.blur == pytest.approx(0.5 * spread, rel=0.25)
    assert np.std((soft - expected)[inside]) < 0.05 * np.std(expected[inside])


def test_photographs_shaken_in_different_directions_are_both_blurred():
    """Each along the direction in which the other one moved."""
    along_x, along_y = (cv2.blur(pattern(), size) for size in ((5, 1), (1, 7)))
    target = spline(noisy(along_y, 2))
    soft, softer, _ = equally_sharp(noisy(along_x, 1), EVERYWHERE, target, PLACES, warps(np.eye(2)), 0.0)
    inside = np.s_[60:-60, 60:-60]
    assert np.std((soft - softer.image)[inside]) < 0.15 * np.std((along_x - along_y)[inside])


def test_a_blur_of_a_compressed_photograph_is_found():
    """Noise of the target is stronger in what is resampled, and counts as no pattern."""
    gradient, middle, sigma = np.diag([1.3, 0.45]), 0.5 * (SIDE - 1), 1.8
    pressed = np.column_stack([gradient, middle - gradient @ [middle, middle]])
    wide = np.asarray(128.0 + 3.0 * (cv2.GaussianBlur(pattern(), (0, 0), 3.0) - 128.0), dtype=np.float32)
    seen = cv2.warpAffine(wide, pressed, (SIDE, SIDE), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REFLECT)
    target = spline(noisy(cv2.GaussianBlur(seen, (0, 0), sigma), 2))
    near = np.abs(warps(gradient)[..., 0] - middle).max(axis=1) < 150.0
    near &= np.abs(PLACES - middle).max(axis=1) < 130.0
    _, _, damping = equally_sharp(noisy(wide, 1), EVERYWHERE, target, PLACES[near], warps(gradient)[near], 0.0)
    assert damping.blur == pytest.approx(0.5 * sigma**2 * (1.3**-2 + 0.45**-2), rel=0.15)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_blur_along_one_axis_leaves_the_other_photograph_as_it_is(sign):
    """Whatever rounding makes of the variance across it."""
    for angle in np.linspace(0.0, np.pi, 37):
        axis = np.array([np.cos(angle), np.sin(angle)])
        blurs = _further_blurs(sign * 2.0 * np.outer(axis, axis), np.diag([1.2, 0.8]))
        assert [part is None for part in blurs] == [sign < 0.0, sign > 0.0]
