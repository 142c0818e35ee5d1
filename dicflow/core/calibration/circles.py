"""Grids of circles as calibration targets, and their centres in photographs.

The image of a circle is an ellipse whose centre is **not** the image of the circle's centre: under a tilt θ it lies
about r² sin θ cos θ / f beside it, with r the radius in the photograph and f the focal length, both in px; 0.09 px for
r = 20 px, θ = 30° and f = 2000 px. :func:`eccentricity` gives that bias, and it is subtracted.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Bytes, Grey
from dicflow.core.calibration.targets import Size, Target, board_orders
from dicflow.core.matching.transform import apply_transform, estimate_transform, jacobian
from dicflow.core.photographs.grey import reduced, to_8bit

__all__ = ["Ellipses", "circle_points", "circle_target", "detect_blobs", "eccentricity", "find_circles", "fit_ellipses"]


_CELL_SHARE = 0.48
_SMOOTHING_PX = 0.7
_MIN_REDUCED_PX = 500
_MIN_BLOB_AREA_PX2, _MAX_BLOB_AREA_SHARE = 20.0, 0.02
_MAX_MISPLACED = 0.15
"""Largest median distance of the circles from their places under a perspective view [spacings]: rows do not shift."""
_MAX_GRID_OFFSET, _MAX_CONTINUED_SHARE = 0.2, 0.3


class Ellipses(NamedTuple):
    """Ellipses in a photograph: points x with (x − centre)ᵀ shape⁻¹ (x − centre) = 1.

    centres : (n, 2) [px]
    shapes : (n, 2, 2) [px²] — the semi-axes are the square roots of its eigenvalues
    """

    centres: Array
    shapes: Array


def circle_target(size: Size, spacing_mm: float, asymmetric: bool = False) -> Target:
    """A grid of circles.

    size : (columns, rows) of circles; of an asymmetric grid the columns count the circles of **one** row
    spacing_mm : distance of neighbouring rows; of an asymmetric grid half of that between the circles of a row

    A symmetric grid looks the same after a turn by 180° (a square one also by 90°); an asymmetric one does where the
    number of its rows is even.
    """
    points = circle_points(size, spacing_mm, asymmetric)
    if not asymmetric:
        return Target(points, board_orders(size))
    given = np.arange(len(points))
    return Target(points, np.stack([given, given[::-1]] if size[1] % 2 == 0 else [given]))


def circle_points(size: Size, spacing_mm: float, asymmetric: bool = False) -> Array:
    """Centres (columns·rows, 3) [mm], row by row; in an asymmetric grid every other row is shifted by one spacing."""
    columns, rows = size
    y, x = np.mgrid[:rows, :columns].reshape(2, -1)
    x = 2 * x + y % 2 if asymmetric else x
    return float(spacing_mm) * np.stack([x, y, np.zeros_like(x)], axis=-1).astype(float)


def find_circles(image: Grey, size: Size, asymmetric: bool = False) -> Array | None:
    """Centres of a grid of circles in a photograph, dark circles on a bright ground or the reverse.

    The circles are located as blobs; each is then fitted by an ellipse (:func:`fit_ellipses`), whose centre is
    corrected for perspective (:func:`eccentricity`). The bias by lens distortion is not corrected: about r² k₁ x, with
    r and the distance x from the middle of the photograph in focal lengths, mostly below 0.002 px.

    Returns (columns·rows, 2) [px], row by row; None where the photograph does not show a grid of this size.
    """
    located = _locate_centres(to_8bit(image), size, asymmetric)
    if located is None:
        return None
    points = circle_points(size, 1.0, asymmetric)[:, :2]
    homography = _homography(points, located)
    slopes = jacobian(homography, points)
    misplaced = np.linalg.norm(apply_transform(homography, points) - located, axis=-1)
    if np.median(misplaced / np.linalg.norm(slopes, axis=1).min(axis=-1)) > _MAX_MISPLACED:
        return None
    nearest = np.sqrt(2.0) if asymmetric else 1.0
    ellipses = fit_ellipses(image, located, slopes * nearest)
    return ellipses.centres - eccentricity(ellipses, points)


def fit_ellipses(image: Grey, places: Array, cells: Array) -> Ellipses:
    """Fit an ellipse to the edge of each blob by its tangents, the lines normal to the grey-level gradients.

    Each pixel with a gradient gives a tangent l of the ellipse, lᵀ C l = 0 for its dual conic C; weighted by the
    gradient, C follows by linear least squares from all pixels (Ouellet and Hébert 2009, "Precise ellipse estimation
    without contour point extraction"). The image is smoothed by 0.7 px first, because edges sharper than a pixel
    distort the gradients; smoothing does not move the centres.

    places : (n, 2) — blob centres, accurate to about a pixel [px]
    cells : (n, 2, 2) — matrices that map a circle of radius 1 onto the curve that reaches to the next blobs' centres;
        the pixels within 0.48 of it are used [px]
    """
    grey = cv2.GaussianBlur(image.astype(np.float64), (0, 0), _SMOOTHING_PX)
    gradient = np.stack([_central_difference(grey, 1), _central_difference(grey, 0)], axis=-1)
    found = [_dual_conic(gradient, place, cell) for place, cell in zip(places, cells, strict=True)]
    return Ellipses(np.stack([centre for centre, _ in found]), np.stack([shape for _, shape in found]))


def eccentricity(ellipses: Ellipses, points: Array) -> Array:
    """Centres of the ellipses minus the images of the circles' centres (n, 2) [px].

    The homography H of the grid maps a circle's dual conic C to H C Hᵀ in the photograph, which gives the ellipse and
    its centre (Heikkilä 2000). The radius, the same for all circles, is estimated from the ellipses' areas.

    points : (n, 2) — the circles' centres on the target, in any unit
    """
    homography = _homography(points, ellipses.centres)
    areas = np.sqrt(np.linalg.det(ellipses.shapes)) / np.abs(np.linalg.det(jacobian(homography, points)))
    radius = np.sqrt(np.median(areas))
    rays = np.concatenate([points, np.ones((len(points), 1))], axis=-1)
    duals = rays[:, :, None] * rays[:, None] - radius**2 * np.diag([1.0, 1.0, 0.0])
    images = homography @ duals @ homography.T
    return np.asarray(images[:, :2, 2] / images[:, 2:, 2] - apply_transform(homography, points))


def detect_blobs(grey: Bytes) -> Array:
    """Centres (n, 2) of dark round blobs [px]."""
    return np.array([blob.pt for blob in _blob_detector(grey.size).detect(grey)], dtype=float).reshape(-1, 2)


def _locate_centres(grey: Bytes, size: Size, asymmetric: bool) -> Array | None:
    """Centres accurate to about a pixel, row by row; first in a reduced photograph, which suffices for most grids."""
    scale = 1.0
    while max(grey.shape) * scale / 2.0 >= _MIN_REDUCED_PX:
        scale /= 2.0
    while scale <= 1.0:
        small = reduced(grey, scale)
        for dark in (True, False):
            found = _detect_grid(small if dark else np.asarray(255 - small, dtype=np.uint8), size, asymmetric)
            if found is not None:
                return (found + 0.5) / scale - 0.5
        scale *= 2.0
    return None


def _detect_grid(grey: Bytes, size: Size, asymmetric: bool) -> Array | None:
    """Centres of a grid of dark blobs in front order; None if it is not detected or is part of a larger grid."""
    kind = cv2.CALIB_CB_ASYMMETRIC_GRID if asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    blobs = detect_blobs(grey)
    if len(blobs) < size[0] * size[1]:
        return None
    for method in (0, cv2.CALIB_CB_CLUSTERING):
        cv2.setRNGSeed(0)
        found, centres = cv2.findCirclesGrid(grey, size, flags=kind | method, blobDetector=_blob_detector(grey.size))
        if found:
            front = _in_front_order(centres.reshape(-1, 2).astype(float), size, asymmetric)
            return front if front is not None and not _is_part_of_larger_grid(front, blobs, size, asymmetric) else None
    return None


def _is_part_of_larger_grid(centres: Array, blobs: Array, size: Size, asymmetric: bool) -> bool:
    """Whether blobs continue the grid beyond its outermost rows or columns: then its position in it is unknown."""
    columns, rows = size
    points = circle_points(size, 1.0, asymmetric)[:, :2]
    on_target = apply_transform(_homography(centres, points), blobs)
    pitch = 2.0 if asymmetric else 1.0
    near = np.abs(on_target - np.round(on_target)).max(axis=-1) < _MAX_GRID_OFFSET
    column, row = np.round(on_target[near]).T
    ahead = (row >= 0) & (row < rows) & np.isin(column, (-pitch, pitch * columns))
    beyond = (column >= 0) & (column < pitch * columns) & np.isin(row, (-1, rows))
    return bool(max(np.count_nonzero(ahead) / rows, np.count_nonzero(beyond) / columns) > _MAX_CONTINUED_SHARE)


def _blob_detector(area_px: int) -> cv2.SimpleBlobDetector:
    """OpenCV's detector of round blobs for an image of that many pixels."""
    settings = cv2.SimpleBlobDetector.Params()
    settings.minArea, settings.maxArea = _MIN_BLOB_AREA_PX2, _MAX_BLOB_AREA_SHARE * area_px
    settings.minThreshold, settings.maxThreshold = 20.0, 240.0
    settings.minDistBetweenBlobs = 4.0
    settings.filterByConvexity = False
    settings.filterByCircularity, settings.minCircularity = True, 0.6
    return cv2.SimpleBlobDetector.create(settings)


def _in_front_order(centres: Array, size: Size, asymmetric: bool) -> Array | None:
    """The centres in the order of the target's front; None for the mirror image of an asymmetric grid."""
    points = circle_points(size, 1.0, asymmetric)[:, :2]
    if np.linalg.det(jacobian(_homography(points, centres), points)).mean() > 0.0:
        return centres
    return None if asymmetric else centres.reshape(size[1], size[0], 2)[:, ::-1].reshape(-1, 2)


def _central_difference(grey: Array, axis: int) -> Array:
    """Central differences along an axis; 0 on the border."""
    slope = np.zeros_like(grey)
    inner = np.moveaxis(slope, axis, 0)
    along = np.moveaxis(grey, axis, 0)
    inner[1:-1] = 0.5 * (along[2:] - along[:-2])
    return slope


def _dual_conic(gradient: Array, place: Array, cell: Array) -> tuple[Array, Array]:
    """Centre (2,) and shape (2, 2) of the ellipse around a place, as in :func:`fit_ellipses`."""
    reach = _CELL_SHARE * np.linalg.norm(cell, axis=1)
    low = np.maximum(np.floor(place - reach), 0).astype(int)
    high = np.ceil(place + reach).astype(int) + 1
    window = gradient[low[1] : high[1], low[0] : high[0]]
    y, x = np.mgrid[low[1] : low[1] + window.shape[0], low[0] : low[0] + window.shape[1]]
    offset = np.stack([x, y], axis=-1) - place
    inside = np.linalg.norm(offset @ np.linalg.inv(cell).T, axis=-1) < _CELL_SHARE
    scale = float(reach.max())
    a, b = window[inside].T
    c = -np.sum(window[inside] * offset[inside], axis=-1) / scale
    rows = np.stack([a * a, a * b, b * b, a * c, b * c], axis=-1)
    conic = np.linalg.lstsq(rows, -c * c, rcond=None)[0]
    centre = conic[3:] / 2.0
    dual = np.array([[conic[0], conic[1] / 2.0], [conic[1] / 2.0, conic[2]]])
    return place + scale * centre, scale**2 * (np.outer(centre, centre) - dual)


def _homography(points: Array, pixels: Array) -> Array:
    """The homography (3, 3) that maps points (n, 2) onto pixels (n, 2) best."""
    return estimate_transform("projective", points, pixels)
