"""What the pattern of the first photograph allows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dicflow.errors import StageError

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.photographs.pattern import Pattern
    from dicflow.core.photographs.repetition import Repetition

__all__ = ["pattern_of_region", "repetition_facts", "repetition_of_region"]

_MAX_STRIPES_SHARE = 0.5
"""Share of the region that may show stripes."""


def pattern_of_region(image: np.ndarray, usable: np.ndarray, subset_size: int) -> Pattern:
    """The pattern of the first photograph. Raises StageError unless it distinguishes subsets."""
    from dicflow.core.photographs.pattern import checked_pattern

    try:
        return checked_pattern(image, usable, subset_size, "the first left photograph")
    except ValueError as error:
        raise StageError(str(error)) from error


def repetition_of_region(image: np.ndarray, region: np.ndarray) -> Repetition:
    """How the pattern repeats itself. Raises StageError for stripes."""
    from dicflow.core.photographs.repetition import repetition

    found = repetition(image, region)
    if found.stripes_share > _MAX_STRIPES_SHARE:
        raise StageError(
            f"{found.stripes_share:.0%} of the region shows stripes in the first left photograph, and a displacement "
            "along them cannot be measured; apply random speckles"
        )
    return found


def repetition_facts(found: Repetition) -> dict[str, Any]:
    """Attributes of a pattern that repeats itself; empty for any other."""
    if not found.share > 0.0:
        return {}
    text = (
        f"the pattern repeats every {found.period_px:.1f} px in {found.share:.0%} of the region: a displacement beyond "
        f"{0.5 * found.period_px:.1f} px from one step to the next looks the same as a shorter one; apply random "
        "speckles, or photograph smaller steps"
    )
    return {"period_px": found.period_px, "repeating_share": found.share, "warnings": [text]}
