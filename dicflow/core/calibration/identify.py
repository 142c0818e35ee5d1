"""Which calibration board a photograph shows, without regard to the expected one.

ChArUco boards are recognised by their markers, whose numbers also give the board's size and whether its first square
is white; checkerboards by their corners; grids of circles by the lattice of their blobs. Large photographs are reduced
first, so that each is judged in a fraction of a second.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Bytes, Grey, Index
from dicflow.core.calibration.board import MARKER_COUNTS, Board
from dicflow.core.calibration.charuco import marker_dictionary
from dicflow.core.calibration.circles import detect_blobs
from dicflow.core.calibration.lattice import lattice_places
from dicflow.core.calibration.targets import SMALLEST_BOARD, detect_checkerboard
from dicflow.core.matching.transform import apply_transform, estimate_transform, transfer_error
from dicflow.core.photographs.grey import reduced, scale_for, to_8bit

__all__ = ["identify_board", "marker_board"]


_MAX_PIXELS = 1_500_000
_FAMILIES = ("4x4_1000", "5x5_1000", "6x6_1000", "7x7_1000", "aruco_original", "apriltag_16h5", "apriltag_25h9",
             "apriltag_36h10", "apriltag_36h11")  # fmt: skip
"""Dictionaries that hold all others: 4x4_50 is the beginning of 4x4_1000."""
_MIN_MARKERS, _CERTAIN_MARKERS = 6, 12
_MIN_FITTING_SHARE = 0.7
_SQUARES = range(3, 41)
_MAX_MISPLACED = 0.15
"""Largest distance of a marker's centre and corners from their places on the board [squares]."""
_MAX_TRIALS, _MAX_CANDIDATES = 100, 4
_MARGIN_SQUARES = 1.4
"""Distance from the outermost corners at which a whole board has ended [squares]."""
_MAX_MARGIN_CONTRAST = 0.35
"""Largest range of the grey levels in that margin, over the contrast of the squares."""
_MIN_STEP = 0.4
"""Least difference of two neighbouring squares, over the usual one."""
_MIN_GAP_LEVEL = 0.7
"""Least level between circles, from ink 0 to paper 1: where squares touch, it is about a half."""


class _Fit(NamedTuple):
    """Markers that lie where they would on a board.

    columns, rows : of its squares
    share : side of a marker in squares
    fitting : number of the markers
    """

    columns: int
    rows: int
    share: float
    fitting: int


def identify_board(image: Grey, thorough: bool = True) -> Board | None:
    """The board in a photograph; None if no board is seen, or only a part of a grid of circles.

    Of a checkerboard or ChArUco board that is cut off, the size is that of the visible part, or up to the last marker.

    thorough : search for a checkerboard that is cut off or hardly shows, too, which takes ten times longer
    """
    grey = to_8bit(image)
    grey = reduced(grey, scale_for(grey, _MAX_PIXELS))
    whole = marker_board(grey) or _circle_grid(grey) or _checkerboard(grey, thorough=False)
    return _checkerboard(grey, thorough=True) if whole is None and thorough else whole


def marker_board(grey: Bytes) -> Board | None:
    """The ChArUco board whose markers an image shows; None with fewer than six markers of one board.

    The first square of the board may be black or white.
    """
    best: tuple[int, Board] | None = None
    for family in _FAMILIES:
        corners, numbers, _ = cv2.aruco.ArucoDetector(marker_dictionary(family)).detectMarkers(grey)
        if numbers is None or len(numbers) < max(_MIN_MARKERS, best[0] if best else 0):
            continue
        fit = _fit_markers(np.stack(corners).reshape(-1, 4, 2).astype(float), numbers.reshape(-1))
        if fit is not None:
            size, needed = (fit.columns - 1, fit.rows - 1), fit.columns * fit.rows // 2
            best = fit.fitting, Board("charuco", size, _smallest_dictionary(family, needed), round(fit.share, 2))
            if fit.fitting >= _CERTAIN_MARKERS:
                break
    return best[1] if best else None


def _checkerboard(grey: Bytes, thorough: bool) -> Board | None:
    """The checkerboard that an image shows as a whole, with its margin; by a thorough search also the part of one."""
    flags = cv2.CALIB_CB_LARGER | (cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE if thorough else 0)
    grid = detect_checkerboard(grey, SMALLEST_BOARD, flags)
    if grid is None:
        return None
    squares = _Squares.seen(grey, grid)
    is_board = squares.alternate and (thorough or squares.end)
    return Board("checkerboard", (max(grid.shape[:2]), min(grid.shape[:2]))) if is_board else None


class _Squares(NamedTuple):
    """Grey levels in the middles of squares.

    inner : (rows, cols) — of those between the corners
    margin : (n,) — on the paper around the board, if it ends there; NaN outside the photograph
    """

    inner: Array
    margin: Array

    @classmethod
    def seen(cls, grey: Bytes, grid: Array) -> _Squares:
        """The squares of a grid (i, j, 2) of corners [px]."""
        rows, columns = grid.shape[:2]
        places = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2).astype(float)
        to_image = estimate_transform("projective", places, grid.reshape(-1, 2))
        cells = np.stack(np.meshgrid(np.arange(columns - 1) + 0.5, np.arange(rows - 1) + 0.5), axis=-1)
        inner = _levels(grey, apply_transform(to_image, cells.reshape(-1, 2)))
        return cls(
            inner.reshape(rows - 1, columns - 1), _levels(grey, apply_transform(to_image, _around(columns, rows)))
        )

    @property
    def alternate(self) -> bool:
        """Whether black and white squares alternate: all neighbours differ about equally."""
        sign = np.where(np.add.outer(*map(np.arange, self.inner.shape)) % 2 == 0, 1.0, -1.0)
        across, down = np.diff(self.inner, axis=1) * sign[:, 1:], np.diff(self.inner, axis=0) * sign[1:]
        step = np.concatenate([across.ravel(), down.ravel()])
        usual = float(np.median(step))
        return bool((step * np.sign(usual) > _MIN_STEP * abs(usual)).all())

    @property
    def end(self) -> bool:
        """Whether the board ends on all sides, on paper of one brightness."""
        return bool(np.isfinite(self.margin).all() and np.ptp(self.margin) < _MAX_MARGIN_CONTRAST * np.ptp(self.inner))


def _smallest_dictionary(family: str, markers: int) -> str:
    """The smallest dictionary of a family that holds so many markers."""
    kind = family.rsplit("_", 1)[0]
    fitting = [name for name in MARKER_COUNTS if name.startswith(f"{kind}_") and MARKER_COUNTS[name] >= markers]
    return fitting[0] if family.endswith("_1000") and fitting else family


def _fit_markers(corners: Array, numbers: Index) -> _Fit | None:
    """The board on which most of the markers, corners (n, 4, 2) [px], lie in their places."""
    fits = [_fit_board(corners, places) for places in _likeliest(corners.mean(axis=1), _possible_places(numbers))]
    best = max((fit for fit in fits if fit is not None), key=lambda fit: fit.fitting, default=None)
    return best if best and best.fitting >= max(_MIN_MARKERS, _MIN_FITTING_SHARE * len(numbers)) else None


def _likeliest(centres: Array, candidates: Iterable[tuple[int, Index]]) -> list[tuple[int, Index]]:
    """The few candidates that a perspective view of all markers, centres (n, 2) [px], fits best."""
    candidates = list(candidates)
    squares = np.stack([places for _, places in candidates]).astype(float)
    source = np.broadcast_to(centres, squares.shape)
    error = np.median(transfer_error(estimate_transform("projective", source, squares), source, squares), axis=-1)
    return [candidates[k] for k in np.argsort(error)[:_MAX_CANDIDATES]]


def _possible_places(numbers: Index) -> Iterator[tuple[int, Index]]:
    """Columns of squares, and the squares (n, 2) of the markers on a board of so many, its first one black or white."""
    count = int(numbers.max()) + 1
    for columns in _SQUARES:
        row, column = np.divmod(np.arange(2 * count + 2 * columns), columns)
        for first_is_white in (False, True):
            white = np.flatnonzero((row + column + first_is_white) % 2 == 1)[numbers]
            yield columns, np.stack([column[white], row[white]], axis=-1)


def _fit_board(corners: Array, places: tuple[int, Index]) -> _Fit | None:
    """How many markers fit their squares under a perspective view of the board; None if it is unknown."""
    columns, squares = places
    centres = squares + 0.5
    homography, _ = cv2.findHomography(corners.mean(axis=1), centres, cv2.RANSAC, _MAX_MISPLACED, maxIters=_MAX_TRIALS)
    if homography is None:
        return None
    on_board = apply_transform(homography, corners.reshape(-1, 2)).reshape(corners.shape)
    near = np.linalg.norm(on_board.mean(axis=1) - centres, axis=-1) < _MAX_MISPLACED
    offsets = np.abs(on_board - centres[:, None])
    share = 2.0 * float(np.median(offsets[near])) if near.any() else 0.0
    fitting = near & (np.abs(offsets - share / 2.0).max(axis=(1, 2)) < _MAX_MISPLACED)
    if not 0.2 < share < 1.0 or not fitting.any():
        return None
    side_px = float(np.median(np.linalg.norm(np.diff(corners[fitting], axis=1), axis=-1)))
    share *= 1.0 + 1.0 / side_px  # the detector's outlines run through the centres of the outermost dark pixels
    return _Fit(columns, int(squares[fitting, 1].max()) + 1, share, int(fitting.sum()))


def _around(columns: int, rows: int) -> Array:
    """Places (n, 2) in the margin of a board with so many corners [squares]: opposite the middles of its squares."""
    along_x, along_y = np.arange(-1, columns) + 0.5, np.arange(-1, rows) + 0.5
    low, high = -_MARGIN_SQUARES, np.array([columns, rows]) - 1 + _MARGIN_SQUARES
    sides = [np.stack([along_x, np.full(columns + 1, y)], axis=-1) for y in (low, high[1])]
    across = [np.stack([np.full(rows + 1, x), along_y], axis=-1) for x in (low, high[0])]
    return np.concatenate([*sides, *across])


def _levels(grey: Bytes, places: Array) -> Array:
    """Grey levels (n,) of a slightly smoothed image at places (n, 2) [px]; NaN outside."""
    smooth = cv2.blur(grey, (3, 3)).astype(np.float32)
    found = cv2.remap(smooth, places.astype(np.float32)[None], None, cv2.INTER_LINEAR, borderValue=(np.nan,))
    return np.asarray(found[0], dtype=float)


def _circle_grid(grey: Bytes) -> Board | None:
    """The grid of circles, dark or bright, that an image shows as a whole."""
    for image in (grey, np.asarray(255 - grey, dtype=np.uint8)):
        blobs = detect_blobs(image)
        places = lattice_places(blobs)
        on_grid = np.isfinite(places[:, 0])
        if on_grid.sum() < 9 or not _are_apart(image, blobs[on_grid]):
            continue
        whole = places[on_grid].astype(int)
        board = _symmetric_grid(whole) or _asymmetric_grid(whole)
        if board is not None:
            return board
    return None


def _are_apart(grey: Bytes, blobs: Array) -> bool:
    """Whether there is paper between dark blobs (n, 2) and their nearest neighbours; squares touch at their corners."""
    distance = np.linalg.norm(blobs[:, None] - blobs[None], axis=-1) + np.diag(np.full(len(blobs), np.inf))
    (x0, y0), (x1, y1) = blobs.min(axis=0).astype(int), blobs.max(axis=0).astype(int)
    ink, paper = np.nanmedian(_levels(grey, blobs)), np.percentile(grey[y0 : y1 + 1, x0 : x1 + 1], 90)
    between = np.nanmedian(_levels(grey, (blobs + blobs[distance.argmin(axis=1)]) / 2.0))
    return bool(between - ink > _MIN_GAP_LEVEL * (paper - ink))


def _symmetric_grid(places: Index) -> Board | None:
    """A grid whose places (n, 2) fill a rectangle."""
    span = np.ptp(places, axis=0) + 1
    whole = min(span) >= 3 and len(places) == span.prod()
    return Board("circles", (int(span.max()), int(span.min()))) if whole else None


def _asymmetric_grid(places: Index) -> Board | None:
    """A grid whose places (n, 2), in steps along the diagonals of its rows, fill every other place of a rectangle."""
    turned = np.stack([places[:, 0] + places[:, 1], places[:, 0] - places[:, 1]], axis=-1)
    turned -= turned.min(axis=0)
    for across, down in (turned.T, turned.T[::-1]):
        rows, columns = int(down.max()) + 1, (int(across.max()) + 1) // 2
        if min(rows, columns) >= 3 and (np.bincount(down) == columns).all():
            return Board("asymmetric_circles", (columns, rows))
    return None
