"""The region and its material points carried to a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from dicflow.engine.product import Product
from dicflow.kinds.features import FeatureSet
from dicflow.kinds.kind import GRID, Kind, Layout, laid_out, warned_if_lost
from dicflow.kinds.region import polygons_from_json, polygons_to_json

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.matching.steps import Sight
    from dicflow.core.matching.tracking import TrackedSubsets
    from dicflow.core.photographs.polygon import Polygon

__all__ = ["Track", "TrackedPoints", "last_sight", "lost_track"]

_LAYOUTS = {
    "points": Layout((*GRID, "component"), "px", "material points at this step"),
    "status": Layout(GRID, "1", "valid, or why the place is unknown"),
    "transforms": Layout(("subset_row", "subset_col", "i", "j"), "1", "transform from the previous step"),
}
_LAST = {
    "last_points": Layout((*GRID, "component"), "px", "material points at the last step in which they were found"),
    "last_status": Layout(GRID, "1", "status there"),
    "last_image": Layout(("image_row", "image_col"), "grey level", "photograph of that step"),
}


class TrackedPoints(NamedTuple):
    """Material points at a step.

    points : (rows, cols, 2) [px]; status : (rows, cols)
    polygons : the region's outline [px]
    """

    points: np.ndarray
    status: np.ndarray
    polygons: Sequence[Polygon]


class Track(Kind):
    """Material points, the region's outline and the transforms of its subsets at one step."""

    KINDS: ClassVar = ("track",)

    @classmethod
    def write(
        cls,
        state: TrackedPoints,
        tracked: TrackedSubsets,
        step_size: float,
        summary: Mapping[str, Any],
        warnings: Sequence[str] = (),
    ) -> Product:
        """A product of carried points.

        state : at this step
        tracked : the transforms from the previous step, and the matches that each one fits
        step_size : distance of the points at the first step [px]
        warnings : sentences for the user
        """
        attrs = {
            "polygons": polygons_to_json(state.polygons),
            "step_size": step_size,
            "subsets": _subsets(tracked),
            "summary": dict(summary),
            **({"warnings": list(warnings)} if warnings else {}),
        }
        values = {"points": state.points, "status": state.status, "transforms": tracked.transforms}
        return warned_if_lost(Product("track", laid_out(_LAYOUTS, values), attrs))

    @property
    def polygons(self) -> list[Polygon]:
        """The region's outline at this step [px]."""
        return polygons_from_json(self.product.attrs["polygons"])

    @property
    def is_lost(self) -> bool:
        """Whether no point was found at this step; the outline is that of the last step in which points were."""
        return "last_points" in self

    @property
    def last(self) -> TrackedPoints:
        """The points at the last step in which they were found: this one, or one before."""
        prefix = "last_" if self.is_lost else ""
        return TrackedPoints(self[f"{prefix}points"], self[f"{prefix}status"], self.polygons)

    @property
    def step_size(self) -> float:
        """Distance of the points at the first step [px]."""
        return float(self.product.attrs["step_size"])


def lost_track(track: Product, last: TrackedPoints, sight: Sight | None) -> Product:
    """The track of a step in which no point was found, with what the next step starts from.

    last : the points at the last step in which they were found
    sight : the photograph and features of that step
    """
    layouts, values = dict(_LAST), {"last_points": last.points, "last_status": last.status}
    if sight is not None:
        values["last_image"] = sight.image
        features = FeatureSet.layouts("last_")
        layouts |= features
        values |= dict(zip(features, sight.features, strict=True))
    return replace(track, variables={**track.variables, **laid_out(layouts, values)})


def last_sight(track: Product) -> Sight | None:
    """The photograph and features of that step, of a step that is lost; None if not kept."""
    from dicflow.core.matching.features import Features
    from dicflow.core.matching.steps import Sight

    if "last_image" not in track:
        return None
    return Sight(track["last_image"], Features(*(track[name] for name in FeatureSet.layouts("last_"))))


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
