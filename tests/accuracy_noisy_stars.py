"""Resolution and noise on the noisy photographs of the second DIC challenge itself: `make accuracy`.

The challenge states n as the standard deviation along the middle row of a pair without motion, which is not among the
photographs. It is stated here in two ways: of pairs rendered without motion, from the first star's reference without
noise and the law of the photographs' noise; and of what the star itself leaves at its long waves, beside the polynomial
through its transfer. The second one holds a single row, hence few independent values, and less noise: half a pixel away
from the pixels the interpolant averages it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.photographs.interpolate import Spline, spline
from dicflow.core.synthetic.motion import star_period
from tests.accuracy_stars import SUBSETS
from tests.bars import Figure
from tests.data_folder import SHARED
from tests.stars import AMPLITUDE_PX, Setting, columns, resolution, smooth_transfer, smoothed_row

__all__ = ["noisy_stars"]

FOLDER = SHARED / "challenge_2d"
PLAIN = FOLDER / "star1" / "DIC_Challenge_Wave_Reference_NoiseFree.tif"
MIDDLE, REACH = 250, 60
"""The middle row, and how many rows on either side of it hold the subsets and windows of its points."""
LAW = (0.45, 0.033)
"""a and b of the variance a + b g of a grey level g, as measured on the first star with and without noise."""
PAIRS = 4
LONG_PX = 100.0
"""Period from which waves are long."""
BAR = 0.34
ALONE = [setting._replace(step=2) for setting in SUBSETS]
ALONE += [Setting("affine", 33, step=2, gaussian=s) for s in (8.0, 12.0)]
ALONE += [Setting("quadratic", 33, step=2, gaussian=s) for s in (10.0, 15.0)]
SMOOTHED = [Setting("quadratic", size, window, 4, 4) for size in (17, 21, 25) for window in (9, 11, 13)]
SMOOTHED += [Setting("quadratic", 25, 13, 5, 4), Setting("affine", 9, 15, 3, 4)]


class NoisyStar(NamedTuple):
    """The rows around the middle of a star's two photographs, and the period [px] at column 0 and its growth."""

    name: str
    reference: np.ndarray
    deformed: Spline
    first_period: float
    growth: float

    def period(self, x: np.ndarray) -> np.ndarray:
        """Of the waves at columns x [px]."""
        return self.first_period + self.growth * x


class Noisy(NamedTuple):
    """What a setting resolves of a star [px], and n [px] of what is left at long waves and of pairs without motion."""

    l10: float
    residual: float
    static: float

    @property
    def efficiencies(self) -> tuple[float, float]:
        """MEI with either n."""
        return self.l10 * self.residual, self.l10 * self.static


def noisy_stars() -> Iterator[Figure]:
    """The stars of which noisy photographs are at hand."""
    stars = list(photographed())
    if len(stars) < 2 or not PLAIN.is_file():
        print(f"no noisy stars in {FOLDER}: left out", file=sys.stderr)
        return
    pairs = [(noisy(rows(PLAIN), seed), spline(noisy(rows(PLAIN), seed + PAIRS))) for seed in range(PAIRS)]
    print("\nNoisy stars of the challenge; l10 and n [px], MEI with n of the residual at long waves | of static pairs")
    for kind, settings in (("subsets alone", ALONE), ("polynomials of degree 4", SMOOTHED)):
        measured = {setting: [trade(star, setting, pairs) for star in stars] for setting in settings}
        for setting, trades in measured.items():
            print_trades(setting, trades)
        best = min(measured, key=lambda setting: max(mei for t in measured[setting] for mei in t.efficiencies))
        name = words(best)
        for star, found in zip(stars, measured[best], strict=True):
            for n, mei in zip(("residual", "static pairs"), found.efficiencies, strict=True):
                yield Figure(f"noisy {star.name}, {kind} ({name}): displacement MEI, n of {n}", mei, BAR)


def photographed() -> Iterator[NoisyStar]:
    """The challenge's first and fifth star with noise, where they are at hand."""
    first, fifth = FOLDER / "star1", FOLDER / "star5_noisy"
    files = {
        "star1": (first / "DIC_Challenge_Wave_Reference_Noisy.tif", first / "DIC_Challenge_Wave_Deformed_Noisy.tif"),
        "star5": (fifth / "DIC_Challenge_Star_Noise_Ref.tiff", fifth / "DIC_Challenge_Star_Noise_Def.tiff"),
    }
    growth = 290.0 / 4000.0
    periods = {"star1": (star_period(0.0), star_period(1.0) - star_period(0.0)), "star5": (10.0 - growth, growth)}
    for name, (reference, deformed) in files.items():
        if reference.is_file() and deformed.is_file():
            yield NoisyStar(name, rows(reference), spline(rows(deformed)), *periods[name])


def rows(path: Path) -> np.ndarray:
    """The rows of a photograph around its middle one."""
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[MIDDLE - REACH : MIDDLE + REACH + 1]


def noisy(grey: np.ndarray, seed: int) -> np.ndarray:
    """A photograph with noise of the law, rounded to 8 bits."""
    a, b = LAW
    noise = np.random.default_rng(seed).normal(size=grey.shape) * np.sqrt(a + b * grey)
    return np.clip(np.rint(grey + noise), 0, 255).astype(np.uint8)


def trade(star: NoisyStar, setting: Setting, pairs: list[tuple[np.ndarray, Spline]]) -> Noisy:
    """What a setting resolves of a star, and how much noise it makes."""
    x = columns(setting, setting.step, star.reference.shape[1])
    transfer = smoothed_row(star.reference, star.deformed, REACH, setting) / AMPLITUDE_PX
    left = AMPLITUDE_PX * (transfer - smooth_transfer(x, transfer)(x))[star.period(x) >= LONG_PX]
    static = [smoothed_row(reference, moved, REACH, setting) for reference, moved in pairs]
    return Noisy(
        resolution(x, transfer, star.period), float(np.nanstd(left)), float(np.sqrt(np.nanmean(np.square(static))))
    )


def words(setting: Setting) -> str:
    weight = f", Gaussian {setting.gaussian:g} px" if setting.gaussian else ""
    window = f", {setting.window}×{setting.window} every {setting.step} px" if setting.window > 1 else ""
    return f"{setting.shape_function} {setting.size}{weight}{window}"


def print_trades(setting: Setting, trades: list[Noisy]) -> None:
    text = "".join(
        f"{t.l10:9.2f}{t.residual:9.5f}{t.static:9.5f}{t.efficiencies[0]:8.4f} |{t.efficiencies[1]:7.4f}"
        for t in trades
    )
    print(f"  {words(setting):<38}{text}", flush=True)
