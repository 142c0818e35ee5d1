"""The part of the photographs that the boards cover, and a verdict on a calibration in words."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from dicflow.core.arrays import Array, Mask
from dicflow.core.calibration.calibrate import MAX_NOISE_DISAGREEMENT, Calibration
from dicflow.core.cameras.rig_parameters import key_figures

__all__ = ["covered_area", "empty_parts", "verdict"]

Size = tuple[int, int]

_PART_NAMES = (
    ("upper left", "top", "upper right"),
    ("left", "centre", "right"),
    ("lower left", "bottom", "lower right"),
)
_MIN_COVERED_SHARE = 0.2
_MIN_GOOD_COVERAGE = 0.5
_MIN_GOOD_PAIRS = 10
_MIN_GOOD_TILT_DEG = 10.0
_MAX_GOOD_SPREAD = 1e-4
_LENGTH_FIGURES = slice(0, 5)
_SETTING = {"tangential": "tangential: true", "third radial": "radial: 3"}


def covered_area(boards: Array, image_size: Size, cells: int = 240) -> Mask:
    """Part of the photographs that the boards cover: the union of the convex hulls of their corners.

    boards : (n, m, 2) [px], NaN where not seen
    image_size : (width, height) [px]
    cells : number of cells along the longer side of a photograph
    Returns (rows, cols) bool, one per cell.
    """
    scale = cells / max(image_size)
    area = np.zeros((max(1, round(image_size[1] * scale)), max(1, round(image_size[0] * scale))), np.uint8)
    for corners in boards:
        seen = corners[np.isfinite(corners[:, 0])]
        hull = cv2.convexHull(np.round((seen + 0.5) * scale - 0.5).astype(np.int32))
        cv2.fillConvexPoly(area, hull, 1)
    return area.astype(bool)


def empty_parts(area: Mask) -> list[str]:
    """Names of the ninths of the photographs of which the boards cover less than a fifth ("upper left", …).

    area : (rows, cols) bool, from :func:`covered_area`
    """
    thirds = [np.array_split(band, 3, axis=1) for band in np.array_split(area, 3, axis=0)]
    return [
        name
        for names, band in zip(_PART_NAMES, thirds, strict=True)
        for name, part in zip(names, band, strict=True)
        if part.mean() < _MIN_COVERED_SHARE
    ]


def verdict(calibration: Calibration, areas: Sequence[Mask], max_error_px: float, pairs: int) -> str:
    """Verdict (good, usable or poor), the figures it follows from, and what to improve.

    areas : covered areas of the left and right photographs
    max_error_px : limit of a pair's mean reprojection error
    pairs : number of pairs photographed, including those without a detected board
    """
    used = calibration.used
    share = min(float(area.mean()) for area in areas)
    rms_px = calibration.rms_px[2]
    figures = (
        f"{rms_px:{'.2f' if rms_px >= 0.1 else '.3f'}} px, {np.count_nonzero(used)} of {pairs} pairs, "
        f"boards cover {share:.0%} of the frame".replace("%", " %")
    )
    above = float(calibration.error_px[used].mean(axis=1).max()) > max_error_px
    advice = _advice(calibration, areas, max_error_px if above else None)
    poor = above or np.nanmax(calibration.tilt_deg) < _MIN_GOOD_TILT_DEG
    return f"{'poor' if poor else 'usable' if advice else 'good'}: {'; '.join([figures, *advice])}"


def _advice(calibration: Calibration, areas: Sequence[Mask], missed_limit_px: float | None) -> list[str]:
    """What to improve, one entry per shortcoming.

    missed_limit_px : limit of the reprojection error if a pair exceeds it, else None
    """
    advice = []
    if missed_limit_px is not None:
        advice.append(f"some pairs are above {missed_limit_px:g} px: photograph a flat board, sharp and at rest")
    if np.count_nonzero(calibration.used) < _MIN_GOOD_PAIRS:
        advice.append("take more pairs, about 20")
    if np.nanmax(calibration.tilt_deg) < _MIN_GOOD_TILT_DEG:
        advice.append("the focal length is uncertain: tilt the board by 20° to 40° in some photographs")
    advice += [f"the lenses show distortion that is not estimated: set {_SETTING[k]}" for k in calibration.unmodelled]
    if _depends_on_pairs(calibration):
        remedy = "set that first" if calibration.unmodelled else "use a flat, stiff board, at rest"
        advice.append(
            f"calibrations without some of the pairs differ {calibration.disagreement:.0f} times more than noise "
            f"explains, and the uncertainty is multiplied by that: {remedy}"
        )
    for side, area in zip(("left", "right"), areas, strict=True):
        if area.mean() < _MIN_GOOD_COVERAGE:
            parts = ", ".join(empty_parts(area)) or "edges"
            advice.append(f"place the board also in these parts of the {side} photographs: {parts}")
    return advice


def _depends_on_pairs(calibration: Calibration) -> bool:
    """Whether focal lengths or baseline change with the choice of pairs beyond noise, and by more than 0.01 %."""
    spread = calibration.leave_out.spread[_LENGTH_FIGURES] / key_figures(calibration.rig)[_LENGTH_FIGURES]
    return calibration.disagreement > MAX_NOISE_DISAGREEMENT and float(spread.max()) > _MAX_GOOD_SPREAD
