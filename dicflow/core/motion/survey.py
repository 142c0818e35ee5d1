"""A look at all photographs of a series, one after another: motion, brightness and sharpness."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import cv2
import numpy as np

__all__ = ["Survey", "survey"]

_WIDTH = 480
"""Width of the copies in which features are followed [px]."""
_CELLS = (4, 6)
"""Rows and columns of the cells that the picture is divided into."""
_THUMB = (12, 9)
"""Width and height of the smallest copies [px]."""
_FEATURES, _QUALITY, _APART = 300, 0.01, 7
"""Number of features, least corner measure against the best, and least distance [px]."""
_WINDOW, _LEVELS = (21, 21), 3
"""Window [px] and levels of the pyramid of Lucas and Kanade (IJCAI 1981)."""
_MIN_SHARE, _MAX_SHIFT = 0.6, 0.1
"""Features are looked for anew where fewer are still found, or the median has moved by this share of the width."""


class Survey(NamedTuple):
    """What a look at a series found, photograph by photograph.

    cells : (n, cell, 2) float64 — median displacement x, y of the features of each cell since the first photograph
        [px]; the last one known where a cell has none
    level : (n,) float64 — mean grey level
    sharpness : (n,) float64 — standard deviation of the Laplacian over that of the grey levels
    thumbs : (n, height, width) uint8 — smallest copies
    """

    cells: np.ndarray
    level: np.ndarray
    sharpness: np.ndarray
    thumbs: np.ndarray


def survey(photographs: Iterable[np.ndarray]) -> Survey:
    """Look at photographs (row, col) uint8 or uint16 of one size; one is held at a time."""
    followed = _Features()
    cells, level, sharpness, thumbs = [], [], [], []
    for photograph in photographs:
        small, scale = _small(photograph)
        cells.append(followed.displacements(small) * scale)
        level.append(float(photograph.mean()))
        sharpness.append(_sharpness(small))
        thumbs.append(cv2.resize(small, _THUMB, interpolation=cv2.INTER_AREA))
    return Survey(np.array(cells), np.array(level), np.array(sharpness), np.array(thumbs))


def _small(photograph: np.ndarray) -> tuple[np.ndarray, float]:
    """A copy with 8 bits for features, and how many pixels of the photograph one of its pixels covers."""
    grey = photograph if photograph.dtype == np.uint8 else (photograph >> 8).astype(np.uint8)
    scale = max(grey.shape[1] / _WIDTH, 1.0)
    size = round(grey.shape[1] / scale), round(grey.shape[0] / scale)
    return (grey if scale == 1.0 else cv2.resize(grey, size, interpolation=cv2.INTER_AREA)), scale


def _sharpness(small: np.ndarray) -> float:
    contrast = float(small.std())
    return float(cv2.Laplacian(small, cv2.CV_32F).std()) / contrast if contrast else 0.0


class _Features:
    """Features that are followed from the photograph in which they were found; the sums go on when they are renewed."""

    def __init__(self) -> None:
        self._origin: np.ndarray | None = None
        self._points = self._last = np.empty((0, 1, 2), np.float32)
        self._cell = np.empty(0, int)
        self._base = self._now = np.zeros((_CELLS[0] * _CELLS[1], 2))

    def displacements(self, small: np.ndarray) -> np.ndarray:
        """Displacement of every cell since the first photograph (cell, 2) [px of the copy]."""
        if self._origin is None:
            self._renew(small)
            return self._now
        moved, found = self._followed(small)
        if found.any():
            self._now = self._base + _medians(moved[found], self._cell[found], self._now - self._base)
        if self._is_far(moved, found, small.shape[1]):
            self._renew(small)
        return self._now

    def _followed(self, small: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacements of the features since they were found (feature, 2), and which ones are still found."""
        if not len(self._points):
            return np.empty((0, 2)), np.empty(0, bool)
        places, status, _ = cv2.calcOpticalFlowPyrLK(
            self._origin,
            small,
            self._points,
            self._last.copy(),
            winSize=_WINDOW,
            maxLevel=_LEVELS,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        found = status.ravel() == 1
        self._last = np.where(found[:, None, None], places, self._last)
        return (places - self._points)[:, 0], found

    def _is_far(self, moved: np.ndarray, found: np.ndarray, width: int) -> bool:
        if not found.size or found.mean() < _MIN_SHARE:
            return True
        return bool(np.abs(np.median(moved[found], axis=0)).max() > _MAX_SHIFT * width)

    def _renew(self, small: np.ndarray) -> None:
        self._origin, self._base = small.copy(), self._now
        points = cv2.goodFeaturesToTrack(small, _FEATURES, _QUALITY, _APART)
        self._points = self._last = np.empty((0, 1, 2), np.float32) if points is None else points
        rows, cols = _CELLS
        row = (self._points[:, 0, 1] * rows / small.shape[0]).astype(int)
        self._cell = row * cols + (self._points[:, 0, 0] * cols / small.shape[1]).astype(int)


def _medians(moved: np.ndarray, cell: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Median displacement of each cell (cell, 2); as before where it has no feature."""
    found = before.copy()
    for k in np.unique(cell):
        found[k] = np.median(moved[cell == k], axis=0)
    return found
