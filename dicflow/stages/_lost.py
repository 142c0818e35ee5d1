"""What a stage says of a step in which it finds no point."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

    import numpy as np

    from dicflow.core.status import Status

__all__ = ["lost_status", "lost_warning"]


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
