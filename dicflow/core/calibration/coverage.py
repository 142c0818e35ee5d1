"""How much of the frame the boards cover, and what a calibration is worth, in words."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from dicflow.core.arrays import Array, Mask
from dicflow.core.calibration.calibrate import CHANCE, Calibration
from dicflow.core.cameras.rig_parameters import figures

__all__ = ["covered_area", "empty_parts", "verdict"]

Size = tuple[int, int]

_PARTS = (("upper left", "top", "upper right"), ("left", "centre", "right"), ("lower left", "bottom", "lower right"))
_EMPTY_SHARE = 0.2
_GOOD_COVERAGE = 0.5
_GOOD_PAIRS = 10
_GOOD_TILT_DEG = 10.0
_GOOD_SPREAD = 1e-4
_LENGTHS = slice(0, 5)
_SETTING = {"tangential": "tangential: true", "third radial": "radial: 3"}


def covered_area(boards: Array, image_size: Size, cells: int = 240) -> Mask:
    """Part of the frame that the boards cover: the union of the convex hulls of their corners.

    boards : (n, m, 2) [px], NaN where not seen
    image_size : (width, height) [px]
    cells : number of cells along the longer side
    Returns (rows, cols) bool, one per cell of the frame.
    """
    scale = cells / max(image_size)
    area = np.zeros((max(1, round(image_size[1] * scale)), max(1, round(image_size[0] * scale))), np.uint8)
    for corners in boards:
        seen = corners[np.isfinite(corners[:, 0])]
        hull = cv2.convexHull(np.round((seen + 0.5) * scale - 0.5).astype(np.int32))
        cv2.fillConvexPoly(area, hull, 1)
    return area.astype(bool)


def empty_parts(area: Mask) -> list[str]:
    """Which ninths of the frame no board covers to a fifth, by name ("upper left", …).

    area : (rows, cols) bool, from :func:`covered_area`
    """
    thirds = [np.array_split(band, 3, axis=1) for band in np.array_split(area, 3, axis=0)]
    return [
        name
        for names, band in zip(_PARTS, thirds, strict=True)
        for name, part in zip(names, band, strict=True)
        if part.mean() < _EMPTY_SHARE
    ]


def verdict(calibration: Calibration, areas: Sequence[Mask], max_error_px: float, pairs: int) -> str:
    """What the calibration is worth, and what to photograph again.

    areas : covered areas of the left and right frame
    max_error_px : limit of a pair's mean reprojection error
    pairs : pairs that were photographed, those in which no board was found included
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
    poor = above or np.nanmax(calibration.tilt_deg) < _GOOD_TILT_DEG
    return f"{'poor' if poor else 'usable' if advice else 'good'}: {'; '.join([figures, *advice])}"


def _advice(calibration: Calibration, areas: Sequence[Mask], missed_limit_px: float | None) -> list[str]:
    """What to photograph again, one entry per shortcoming."""
    advice = []
    if missed_limit_px is not None:
        advice.append(f"some pairs are above {missed_limit_px:g} px: photograph a flat board, sharp and at rest")
    if np.count_nonzero(calibration.used) < _GOOD_PAIRS:
        advice.append("take more pairs, 20 are a good number")
    if np.nanmax(calibration.tilt_deg) < _GOOD_TILT_DEG:
        advice.append("the focal length is uncertain: tilt the board by 20° to 40° in some of the photographs")
    advice += [f"the lenses show distortion that is not estimated: set {_SETTING[k]}" for k in calibration.unmodelled]
    if _disagree(calibration):
        remedy = "set that first" if calibration.unmodelled else "use a flat, stiff board, at rest"
        advice.append(
            f"the pairs disagree {calibration.disagreement:.0f} times more than their noise explains, so the rig is "
            f"that much less certain: {remedy}"
        )
    for side, area in zip(("left", "right"), areas, strict=True):
        if area.mean() < _GOOD_COVERAGE:
            parts = ", ".join(empty_parts(area)) or "edges"
            advice.append(f"show the board also in the {side} camera's {parts}")
    return advice


def _disagree(calibration: Calibration) -> bool:
    """Whether focal lengths and baseline depend on the choice of pairs beyond chance, and by more than 0.01 %."""
    spread = calibration.leave_out.spread[_LENGTHS] / figures(calibration.rig)[_LENGTHS]
    return calibration.disagreement > CHANCE and float(spread.max()) > _GOOD_SPREAD
