"""Stars of the second DIC challenge: how short a wave correlation still resolves, and at what noise.

The transfer of a wave of period λ is measured over commanded amplitude in the middle row. l10 is the period at which a
polynomial of degree 12 through it first reaches 0.9, n the standard deviation between two noisy images of the same
reference. Only the rows that subsets of the middle row hold are rendered.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.correlation.subsets import Correlated, Subset, correlate
from dicflow.core.correlation.template import template
from dicflow.core.correlation.warp import identity
from dicflow.core.photographs.interpolate import Spline, slopes, spline
from dicflow.core.surfaces.filters import LocalFit, local_polynomial
from dicflow.core.synthetic.motion import render_pattern, speckle_pattern, star, star_period, strain_star
from dicflow.core.synthetic.render import GreyLevels, add_noise_and_round
from tests.noise import subset_kernel

WIDTH, HEIGHT, MIDDLE = 2000, 101, 50
LOOK = GreyLevels(paper=176.0, ink=83.0)
AMPLITUDE_PX, STRAIN, NOISE = 0.5, 0.05, 2.0
DEGREE, KEPT = 12, 0.9


class Setting(NamedTuple):
    """A subset, and the square of points that a polynomial fits for strains or to smooth; one point is left as it is.

    gaussian : standard deviation of the weight of a subset's pixels [px]; 0 for equal ones
    """

    shape_function: str
    size: int
    window: int = 1
    step: int = 4
    degree: int = 1
    gaussian: float = 0.0

    @property
    def gauge_px(self) -> int:
        return (self.window - 1) * self.step + self.size


class Images(NamedTuple):
    """A reference, a star and a strain star without noise, and the reference twice with it; the middle row."""

    reference: np.ndarray
    star: np.ndarray
    strain_star: np.ndarray
    noisy: tuple[np.ndarray, np.ndarray]
    middle: int


class Dots(NamedTuple):
    """Speckles: least and greatest diameter, width of the edge [px], share of the image that is dark."""

    diameter: tuple[float, float]
    edge: float
    coverage: float


class MiddleRow(NamedTuple):
    """v [px] and its variance for noise of one grey level [px²]; NaN where nothing was found."""

    v: np.ndarray
    variance: np.ndarray


FINE, COARSE = Dots((2.8, 4.8), 2.8, 0.5), Dots((3.9, 7.2), 3.3, 0.48)


def regenerated(seed: int, dots: Dots = FINE) -> Images:
    """A star on speckles of its own; the slopes of the fine ones are those of the challenge's first star."""
    pattern = speckle_pattern((WIDTH, HEIGHT), *dots, seed=seed)
    motions = (None, star(AMPLITUDE_PX, MIDDLE), strain_star(STRAIN, MIDDLE))
    plain = [render_pattern(pattern, (WIDTH, HEIGHT), motion, LOOK) for motion in motions]
    rounded = [add_noise_and_round(image, 0.0, [seed]) for image in plain]
    noisy = (add_noise_and_round(plain[0], NOISE, [seed, 1]), add_noise_and_round(plain[0], NOISE, [seed, 2]))
    return Images(*rounded, noisy, MIDDLE)


def columns(setting: Setting, every: int = 2, width: int = WIDTH) -> np.ndarray:
    """Columns of the middle row whose points have whole subsets."""
    margin = setting.gauge_px // 2 + 3
    return np.arange(margin, width - margin, every)


def middle_row(reference: np.ndarray, target: Spline, middle: int, setting: Setting, every: int = 2) -> MiddleRow:
    """v along the middle row of stars that move by less than a pixel."""
    x = columns(setting, every, reference.shape[1])
    centres = np.stack([x, np.full_like(x, middle)], axis=-1).astype(float)
    result = found(reference, target, centres, setting)
    return MiddleRow(result.warp[:, 1, 0] - middle, result.covariance[:, 2])


def middle_strain(reference: np.ndarray, target: Spline, middle: int, setting: Setting) -> np.ndarray:
    """∂v/∂y along the middle row: of the warp, or of a polynomial through the v of a window of points."""
    if setting.window == 1:
        x = columns(setting, setting.step, reference.shape[1])
        centres = np.stack([x, np.full_like(x, middle)], axis=-1).astype(float)
        return found(reference, target, centres, setting).warp[:, 1, 2] - 1.0
    return middle_fit(reference, target, middle, setting).d_row / setting.step


def smoothed_row(reference: np.ndarray, target: Spline, middle: int, setting: Setting) -> np.ndarray:
    """v along the middle row: of the warp, or of a polynomial through the v of a window of points."""
    if setting.window == 1:
        return middle_row(reference, target, middle, setting, setting.step).v
    return middle_fit(reference, target, middle, setting).value


def middle_fit(reference: np.ndarray, target: Spline, middle: int, setting: Setting) -> LocalFit:
    """Polynomials through the v of windows around the points of the middle row."""
    x, half = columns(setting, setting.step, reference.shape[1]), setting.window // 2
    offsets = setting.step * np.arange(-half, half + 1)
    wide = np.concatenate([x[0] + offsets[:half], x, x[-1] + offsets[half + 1 :]])
    centres = np.stack(np.meshgrid(wide, middle + offsets), axis=-1).astype(float)
    warp = found(reference, target, centres.reshape(-1, 2), setting).warp
    v = warp[:, 1, 0].reshape(centres.shape[:2]) - centres[..., 1]
    fit = local_polynomial(v, (setting.window, setting.window), setting.degree)
    return LocalFit._make(values[half, half:-half] for values in fit)


def found(reference: np.ndarray, target: Spline, centres: np.ndarray, setting: Setting) -> Correlated:
    """Subsets that hardly move."""
    subset = Subset(setting.size, setting.shape_function, setting.gaussian)
    start = identity(centres, setting.shape_function)
    return correlate(template(spline(reference)), target, centres, start, subset)


def gradient_noise(reference: np.ndarray, middle: int, setting: Setting) -> float:
    """√2 σ/√Σg_y² along the middle row [px], the theoretical n of an affine subset (Pan et al. 2008).

    A quadratic subset has so much more as its least-squares kernel is larger than the affine one's, the mean.
    """
    square = slopes(spline(reference))[1].astype(np.float64) ** 2
    total = cv2.boxFilter(square, -1, (setting.size, setting.size), normalize=False)[middle, columns(setting)]
    kernel = subset_kernel(setting.size, setting.shape_function, normalised=False)
    return float(setting.size * np.linalg.norm(kernel) * np.sqrt(np.mean(2.0 * NOISE**2 / total)))


def theoretical_transfer(setting: Setting) -> np.ndarray:
    """What a least-squares polynomial over the subset's square keeps of the wave at its middle."""
    y = np.arange(setting.size) - setting.size // 2
    powers = 1 if setting.shape_function == "affine" else 3
    kernel = np.linalg.pinv(np.stack([y.astype(float) ** p for p in range(powers)], axis=-1))[0]
    return np.cos(2.0 * np.pi * y / star_period(columns(setting))[:, None]) @ kernel


def transfer_of_pattern(reference: np.ndarray, middle: int, setting: Setting, x: np.ndarray) -> np.ndarray:
    """The same of the pattern that is there: least squares weighted by its own grey-level slopes, at columns x.

    The normal equations of correlation, linear in a small wave, with brightness and contrast free.
    """
    image, half = template(spline(reference)), setting.size // 2
    eta, xi = np.mgrid[-half : half + 1, -half : half + 1] / half
    monomials = [np.ones_like(xi), xi, eta] + [xi * xi, xi * eta, eta * eta] * (setting.shape_function == "quadratic")
    transfer = []
    for column in x:
        here = np.s_[middle - half : middle + half + 1, column - half : column + half + 1]
        grey, by_x, by_y = (part[here].astype(float) for part in (image.grey, image.by_x, image.by_y))
        terms = [by_y * m for m in monomials] + [by_x * m for m in monomials] + [np.ones_like(grey), grey - grey.mean()]
        design = np.stack(terms, axis=-1).reshape(grey.size, -1)
        wave = np.cos(2.0 * np.pi * half * eta / star_period(column + half * xi))
        transfer.append(np.linalg.solve(design.T @ design, design.T @ (by_y * wave).ravel())[0])
    return np.array(transfer)


def resolution(x: np.ndarray, transfer: np.ndarray, period: Callable = star_period) -> float:
    """l10 [px]; period : of the star's waves at columns x [px]"""
    fit = smooth_transfer(x, transfer)
    fine = np.arange(x[0], x[-1], 0.1)
    above = fit(fine) >= KEPT
    first = int(np.argmax(~above[:-1] & above[1:]))
    return float(period(fine[first]))


def smooth_transfer(x: np.ndarray, transfer: np.ndarray) -> np.polynomial.Polynomial:
    """The polynomial through a transfer at columns x; NaN is left out."""
    known = np.isfinite(transfer)
    return np.polynomial.Polynomial.fit(x[known], transfer[known], DEGREE)
