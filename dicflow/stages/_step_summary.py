"""Scalars of a step of points that were followed in time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.correlation.points import FoundPoints
    from dicflow.core.photographs.noise import Noise

__all__ = ["step_summary"]


def step_summary(found: FoundPoints, noise: Noise, overexposed: float) -> dict[str, Any]:
    """Scalars of a step; null without valid points.

    overexposed : share of the region's pixels; NaN if it is outside the photograph
    """
    import numpy as np

    from dicflow.core.correlation.points import VIA_REFERENCE_STEP
    from dicflow.core.status import Status

    valid = found.valid
    in_region = valid | (found.status != Status.OUTSIDE) | np.isfinite(found.znssd)

    def median(values: np.ndarray) -> float | None:
        return float(np.median(values[valid])) if valid.any() else None

    return {
        "points": int(valid.sum()),
        "valid_share": float(valid.sum() / max(int(in_region.sum()), 1)),
        "chained_points": int((found.route == VIA_REFERENCE_STEP).sum()),
        "znssd": median(found.znssd),
        "iterations": median(found.iterations),
        "noise_grey": noise.grey,
        "overexposed_share": overexposed if np.isfinite(overexposed) else None,
    }
