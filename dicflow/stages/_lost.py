"""What a stage says of a step in which it finds no point."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

    import numpy as np

    from dicflow.core.status import Status

__all__ = ["lost_status", "lost_warning", "no_subset"]


def lost_status(status: np.ndarray, image: np.ndarray, reasons: Collection[Status]) -> np.ndarray:
    """Status of points that were all lost: where a photograph has no texture anywhere, for want of texture.

    image : (row, col) — the photograph in which they were searched
    reasons : the codes that this explains; others stay
    """
    import numpy as np

    from dicflow.core.photographs.texture import textured_box
    from dicflow.core.status import Status

    if textured_box(image) is not None:
        return status
    return np.where(np.isin(status, list(reasons)), np.uint8(Status.LOW_TEXTURE), status)


def lost_warning(image: np.ndarray, side: str, check: str = "check that it shows the specimen") -> str:
    """The warning for a left or right photograph (row, col) in which no point is found.

    check : what to do if the photograph has texture
    """
    from dicflow.core.photographs.texture import textured_box

    if textured_box(image) is None:
        return f"no texture in this {side} photograph: all points are lost here; check light and exposure"
    return f"no point is found in this {side} photograph; {check}"


def no_subset(region: np.ndarray, status: np.ndarray, subset_size: int, min_share: float) -> str:
    """The message if no subset of the first photograph can be followed.

    region : (h, w) bool — its pixels in the region; status : (row, col) — of the points
    subset_size : side of the subsets [px]; min_share : of its pixels that a subset needs
    """
    import cv2

    from dicflow.core.status import Status

    if (status == Status.OVEREXPOSED).sum() > (status == Status.CUT_SUBSET).sum():
        return (
            f"no subset of {subset_size} px has enough pixels that are neither white nor black nor hidden in "
            "the first left photograph; change the exposure, or take a larger subset_size"
        )
    _, _, width, height = cv2.boundingRect(region.astype("uint8"))
    return (
        f"no subset of {subset_size} px has {min_share:.0%} of its pixels inside the region ({width} × {height} px); "
        f"take a subset_size of {max(5, min(width, height) // 2) | 1} px, or a larger region"
    )
