"""Whether a rig fits the photographs that are measured with it, and what else it may be."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dicflow.errors import StageError
from dicflow.kinds.images import Images

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from dicflow.core.cameras.camera import Rig
    from dicflow.core.correlation.points import FoundPoints
    from dicflow.kinds.correlation import Correlation
    from dicflow.kinds.rig import CalibratedRig

__all__ = ["bump_warnings", "check_found", "check_sizes", "misfit"]

_FOUND_SHARE = 0.5
"""Share of found points from which they decide the order of left and right; below it, features do."""

_MIN_MISFIT_PX = 1.0
"""Median distance of features from their epipolar lines up to which a rig fits."""

_MIN_BUMP_PX, _MIN_BUMP_RATIO, _MIN_BUMP_GAIN = 0.2, 3.0, 10.0
"""Median distance of measured points from their epipolar lines, its ratio to that of a refined rig, logarithm of the
evidence for a motion of the cameras, from which they are said to have been bumped."""


def check_sizes(cameras: Rig, images: Images, places: np.ndarray) -> None:
    """Raise StageError where a camera was calibrated on photographs of another size; it says what may have happened.

    places : (..., 2) — points in the left photograph, around which features are matched [px]
    """
    try:
        images.check_sizes(cameras)
    except StageError as error:
        text = misfit(cameras, images, places, 0.0)
        raise StageError(f"{str(error).partition(';')[0]}; {text}" if text else str(error)) from error


def check_found(cameras: Rig, images: Images, points: Correlation, found: FoundPoints, max_epipolar_px: float) -> None:
    """Raise StageError where points of the left photograph are not found since the rig does not fit, or another reason.

    points : in the left photograph; found : in the right one
    """
    import numpy as np

    from dicflow.core.cameras.epipolar import epipolar_distance
    from dicflow.core.cameras.geometry_check import check_order
    from dicflow.core.correlation.seed import feature_pairs

    places = points["xy"]
    apart = epipolar_distance(cameras, places, found.warp[..., 0])
    enough = _FOUND_SHARE * np.isfinite(places).all(axis=-1).sum()
    is_found = found.valid.sum() >= enough
    pairs = (places, found.warp[..., 0]) if is_found else feature_pairs(images.left, images.right, places)
    order = check_order(cameras, *pairs)
    if order.swapped:
        raise StageError(order.text)
    nothing = not np.isfinite(found.znssd).any()
    if nothing and np.isfinite(points.reach_px):
        raise StageError(
            "no point of the region is found in the right photograph, since the pattern repeats itself and many places "
            "along the epipolar lines look the same; apply random speckles"
        )
    if np.count_nonzero(found.valid & (apart <= max_epipolar_px)) < enough:
        text = misfit(cameras, images, places, max_epipolar_px)
        if text:
            raise StageError(text)
    if nothing:
        raise StageError(
            "no point of the region is found in the right photograph; check that both photographs show the specimen, "
            "well exposed, and are of one moment"
        )


def bump_warnings(rig: CalibratedRig, points: Correlation, found: FoundPoints) -> Sequence[str]:
    """A warning if the measured points show that the cameras have moved since the calibration.

    points : in the left photograph; found : in the right one
    """
    import numpy as np

    from dicflow.core.cameras.epipolar import epipolar_distance
    from dicflow.core.cameras.relative_orientation import MIN_POINTS, MatchedPoints, refine_rig
    from dicflow.core.cameras.rig_misfit import REFINE

    apart = slice(None, None, max(1, round(points.grid.subset_size / points.grid.step_size)))
    values = points["xy"], found.warp[..., 0], points["template"], found.covariance
    left, right, *errors = (part[apart, apart].reshape(-1, part.shape[-1]) for part in values)
    known = np.isfinite(np.concatenate([left, right, *errors], axis=-1)).all(axis=-1)
    matched = MatchedPoints(left[known], right[known], *(part[known] for part in errors))
    before = np.nanmedian(epipolar_distance(rig.cameras, *matched[:2])) if known.any() else 0.0
    if before < _MIN_BUMP_PX or known.sum() < MIN_POINTS:
        return []
    try:
        refined = refine_rig(rig.cameras, rig.covariance, matched)
    except ValueError:  # points behind the cameras
        return []
    after = np.nanmedian(epipolar_distance(refined.rig, *matched[:2]))
    if after * _MIN_BUMP_RATIO > before or refined.gain < _MIN_BUMP_GAIN:
        return []
    return [
        f"the points lie {before:.2g} px from their epipolar lines (median), as after a turn of the right camera by "
        f"{refined.apparent_turn_deg:.2g}° since the calibration; {REFINE}"
    ]


def misfit(cameras: Rig, images: Images, places: np.ndarray, limit_px: float) -> str:
    """Why the rig does not fit the photographs; "" if it does, or if too few features match.

    limit_px : distance from the epipolar lines from which it does not fit, or 1 px if that is more
    """
    from dicflow.core.cameras.rig_misfit import Matched, explain_misfit
    from dicflow.core.correlation.seed import epipolar_pairs

    pairs = epipolar_pairs(images.left, images.right, places)
    sizes = images.left.shape[::-1], images.right.shape[::-1]
    found = explain_misfit(cameras, Matched(pairs.source, pairs.target, sizes), max(limit_px, _MIN_MISFIT_PX))
    return "" if found is None else found.text
