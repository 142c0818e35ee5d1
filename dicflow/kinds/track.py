"""The region and its material points carried to a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from dicflow.engine.product import Product
from dicflow.kinds.kind import GRID, Kind, Layout, laid_out, warned_if_lost
from dicflow.kinds.region import polygons_from_json, polygons_to_json

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.matching.tracking import TrackedSubsets
    from dicflow.core.photographs.polygon import Polygon

__all__ = ["Track"]

_LAYOUTS = {
    "points": Layout((*GRID, "component"), "px", "material points at this step"),
    "status": Layout(GRID, "1", "valid, or why the place is unknown"),
    "transforms": Layout(("subset_row", "subset_col", "i", "j"), "1", "transform from the previous step"),
}


class Track(Kind):
    """Material points, the region's outline and the transforms of its subsets at one step."""

    KINDS: ClassVar = ("track",)

    @classmethod
    def write(
        cls,
        points: np.ndarray,
        status: np.ndarray,
        polygons: Sequence[Polygon],
        tracked: TrackedSubsets,
        step_size: float,
        summary: Mapping[str, Any],
    ) -> Product:
        """A product of carried points.

        points : (row, col, 2) — at this step [px]; status : (row, col)
        polygons : the region's outline at this step [px]
        tracked : the transforms from the previous step, and the matches that each one fits
        step_size : distance of the points at the first step [px]
        """
        attrs = {
            "polygons": polygons_to_json(polygons),
            "step_size": step_size,
            "subsets": _subsets(tracked),
            "summary": dict(summary),
        }
        values = {"points": points, "status": status, "transforms": tracked.transforms}
        return warned_if_lost(Product("track", laid_out(_LAYOUTS, values), attrs))

    @property
    def polygons(self) -> list[Polygon]:
        """The region's outline at this step [px]."""
        return polygons_from_json(self.product.attrs["polygons"])

    @property
    def step_size(self) -> float:
        """Distance of the points at the first step [px]."""
        return float(self.product.attrs["step_size"])


def _subsets(tracked: TrackedSubsets) -> dict[str, Any]:
    """Counts and residual of each subset, by rows and columns of subsets; residual_px is NaN without inliers."""
    return {
        "features": tracked.features.tolist(),
        "matches": tracked.matches.tolist(),
        "inliers": tracked.inliers.tolist(),
        "residual_px": tracked.residual_px.tolist(),
        "filled": tracked.filled.tolist(),
        "empty": tracked.empty.tolist(),
    }
