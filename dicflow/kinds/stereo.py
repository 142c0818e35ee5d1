"""Material points found in the right photograph of a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from dicflow.engine.product import Product
from dicflow.kinds.correlation import FollowedPoints, SubsetGrid, reference_variables
from dicflow.kinds.kind import GRID, Layout, laid_out
from dicflow.kinds.region import polygons_to_json

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.correlation.points import FoundPoints, ReferencePhotograph
    from dicflow.core.photographs.polygon import Polygon

__all__ = ["Stereo"]

_LAYOUTS = {
    "xy": Layout((*GRID, "component"), "px", "place in the right photograph"),
    "gradient": Layout((*GRID, "out", "in"), "1", "gradient of the motion into the right photograph"),
    "warp": Layout((*GRID, "component", "term"), "1", "warp of the subset"),
    "covariance": Layout((*GRID, "pair"), "px²", "covariance of the place by this photograph's noise"),
    "template": Layout((*GRID, "pair"), "px²", "covariance of the place by the noise of the template"),
    "misfit": Layout((*GRID, "pair"), "px²", "share of the misfit of the subset in the covariance"),
    "znssd": Layout(GRID, "1", "ZNSSD"),
    "iterations": Layout(GRID, "1", "iterations"),
    "way": Layout(GRID, "1", "route: 0 no value, 1 direct from the first photograph, 2 via a reference step"),
    "epipolar": Layout(GRID, "px", "distance from the epipolar line"),
    "status": Layout(GRID, "1", "valid, or why the place is unknown"),
}
_FOLLOWED_LAYOUTS = {
    "passed": Layout((*GRID, "pair"), "px²", "share of reference steps in the covariance"),
    "slope": Layout((*GRID, "out", "in"), "1", "gradient of the motion from the reference photograph"),
}


class Stereo(FollowedPoints):
    """Points in the right photograph; NaN where a point is not valid."""

    KINDS: ClassVar = ("stereo",)

    @classmethod
    def write(
        cls,
        found: FoundPoints,
        epipolar: np.ndarray,
        status: np.ndarray,
        grid: SubsetGrid,
        noise_ratio: float,
        facts: Mapping[str, Any],
    ) -> Product:
        """A product of points.

        epipolar : (row, col) — distance from the epipolar line [px]
        status : (row, col) — of both photographs
        noise_ratio : noise of the right camera over that of the left one
        facts : further attributes: match, interpolation, summary
        """
        from dicflow.core.status import Status
        from dicflow.kinds.status import known_or_nan

        kept = status == Status.VALID
        measured = {
            "xy": found.warp[..., 0],
            "gradient": found.warp[..., 1:3],
            "warp": found.warp,
            "covariance": found.covariance,
            "template": found.template_covariance,
            "misfit": found.misfit.astype("f4"),
        }
        values = {name: known_or_nan(kept, array) for name, array in measured.items()}
        values |= {"znssd": found.znssd, "iterations": found.iterations, "way": found.route}
        values |= {"epipolar": epipolar, "status": status}
        attrs = {**grid._asdict(), "noise_ratio": noise_ratio, **facts}
        return Product("stereo", laid_out(_LAYOUTS, values), attrs)

    def with_reference(
        self, found: FoundPoints, polygons: Sequence[Polygon], reference: ReferencePhotograph | None = None
    ) -> Product:
        """The product with all that makes it a reference photograph of the next steps.

        polygons : the region's outline in the right photograph [px]
        reference : the reference step; None while the first photograph is enough
        """
        followed = laid_out(_FOLLOWED_LAYOUTS, {"passed": found.inherited_covariance, "slope": found.slope})
        variables, step_attrs = reference_variables(reference, self.grid.subset_size)
        attrs = {**self.product.attrs, "polygons": polygons_to_json(polygons), **step_attrs}
        return Product("stereo", {**self.product.variables, **followed, **variables}, attrs)

    @property
    def noise_ratio(self) -> float:
        """Noise of the right camera over that of the left one."""
        return float(self.product.attrs["noise_ratio"])

    @property
    def matched_at_every_step(self) -> bool:
        """Whether the cameras are matched at every step, not at the first one only."""
        return bool(self.product.attrs["match"] == "every_step")
