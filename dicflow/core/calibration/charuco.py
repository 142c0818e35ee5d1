"""ChArUco boards: checkerboards with markers in their white squares; a photograph may show any part of one.

Garrido-Jurado et al. 2014, "Automatic generation and detection of highly reliable fiducial markers under occlusion".
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Bytes, Grey, Mask
from dicflow.core.calibration.symmetry import centres_of_symmetry
from dicflow.core.calibration.targets import Size, Target, board_points, determines_pose
from dicflow.core.matching.transform import estimate_transform, jacobian
from dicflow.core.photographs.grey import to_8bit

__all__ = ["Markers", "charuco_target", "find_charuco", "marker_dictionary"]


_RADIUS_SQUARES = 0.6
_MIN_RADIUS_PX = 3
_BLUR_PX = 1.0


class Markers(NamedTuple):
    """The markers of a board.

    dictionary : one of :data:`~dicflow.core.calibration.board.MARKER_COUNTS`
    share : side of a marker as a share of that of a square [-]
    """

    dictionary: str
    share: float


def charuco_target(size: Size, square_mm: float) -> Target:
    """A ChArUco board of (columns, rows) inner corners; its markers identify the corners, so it has one order."""
    points = board_points(size, square_mm)
    return Target(points, np.arange(len(points))[None])


def marker_dictionary(name: str) -> Any:
    """OpenCV's marker dictionary of a name in :data:`~dicflow.core.calibration.board.MARKER_COUNTS`."""
    kind = name.replace("x", "X") if name[0].isdigit() else name.upper().replace("H", "h")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{kind}"))


def find_charuco(image: Grey, size: Size, markers: Markers) -> Array:
    """Corners of the part of a board that a photograph shows, accurate to about 0.005 px.

    The corners are located by the markers; each is then moved to the centre of symmetry of the image around it
    (:func:`~dicflow.core.calibration.symmetry.centres_of_symmetry`) with the markers masked out. The first square may
    be black, or white as on boards by OpenCV before version 4.6.

    Returns (columns·rows, 2) [px], row by row, NaN where a corner is not seen. Where the corners do not determine the
    board's pose (:func:`~dicflow.core.calibration.targets.determines_pose`), they are accurate to about a pixel.
    """
    grey = to_8bit(image)
    corners = max((_locate_corners(grey, size, markers, legacy) for legacy in (False, True)), key=_seen_count)
    seen = np.isfinite(corners[:, 0])
    points = board_points(size, 1.0)
    if not determines_pose(points, seen):
        return corners
    plane = points[seen, :2]
    slopes = jacobian(estimate_transform("projective", plane, corners[seen]), plane)
    spacing = np.linalg.norm(slopes, axis=1).min()
    radius = max(_MIN_RADIUS_PX, round(_RADIUS_SQUARES * float(spacing)))
    windows = _marker_free_pixels(slopes, radius, (1.0 - markers.share) / 2.0)
    corners[seen] = centres_of_symmetry(image, corners[seen], radius, windows)
    return corners


def _locate_corners(grey: Bytes, size: Size, markers: Markers, legacy: bool) -> Array:
    """Corners (columns·rows, 2) accurate to about a pixel, NaN where not seen.

    legacy : whether the board's first square is white
    """
    dictionary = marker_dictionary(markers.dictionary)
    board = cv2.aruco.CharucoBoard((size[0] + 1, size[1] + 1), 1.0, markers.share, dictionary)
    board.setLegacyPattern(legacy)
    found, numbers, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
    corners = np.full((size[0] * size[1], 2), np.nan)
    if numbers is not None:
        corners[numbers.reshape(-1)] = found.reshape(-1, 2)
    return corners


def _seen_count(corners: Array) -> int:
    """Number of corners that are not NaN."""
    return int(np.count_nonzero(np.isfinite(corners[:, 0])))


def _marker_free_pixels(slopes: Array, radius_px: int, gap: float) -> Mask:
    """Which pixels of the windows around corners are free of markers: (n, side, side).

    A marker begins where both coordinates from the corner along the squares exceed the gap between marker and square,
    less the blur of its ink.

    slopes : (n, 2, 2) — squares to pixels at each corner [px]
    gap : width of the white between a marker and its square's side, in squares
    """
    offset = np.arange(-radius_px, radius_px + 1)
    pixels = np.stack(np.meshgrid(offset, offset), axis=-1)
    places = np.einsum("nij,yxj->nyxi", np.linalg.inv(slopes), pixels)
    blur = _BLUR_PX / np.linalg.norm(slopes, axis=1).min()
    return np.asarray(np.abs(places).min(axis=-1) < max(gap - blur, 0.0))
