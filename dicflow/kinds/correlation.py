"""Material points found in the left photograph of a step, and what they are followed from at the next ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from dicflow.engine.product import Product, Variable
from dicflow.kinds.kind import GRID, Kind, Layout, laid_out
from dicflow.kinds.region import polygons_from_json, polygons_to_json

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.correlation.course import Course
    from dicflow.core.correlation.points import FoundPoints, ReferencePhotograph
    from dicflow.core.photographs.noise import Noise
    from dicflow.core.photographs.region import Polygon

__all__ = ["Correlation", "FollowedPoints", "SubsetGrid", "reference_layouts"]

_VECTOR, _SYMMETRIC, _GRADIENT = (*GRID, "component"), (*GRID, "pair"), (*GRID, "out", "in")
_WARP = (*GRID, "component", "term")
_LAYOUTS = {
    "xy": Layout(_VECTOR, "px", "place in the left photograph"),
    "gradient": Layout(_GRADIENT, "1", "deformation gradient in the photograph"),
    "warp": Layout(_WARP, "1", "warp of the subset"),
    "znssd": Layout(GRID, "1", "ZNSSD"),
    "iterations": Layout(GRID, "1", "iterations"),
    "status": Layout(GRID, "1", "why a point has a place, or has none"),
    "covariance": Layout(_SYMMETRIC, "px²", "covariance of the place (xx, xy, yy)"),
    "template": Layout(_SYMMETRIC, "px²", "covariance by the first photograph's noise"),
    "passed": Layout(_SYMMETRIC, "px²", "share of photographs in between in the covariance"),
    "slope": Layout(_GRADIENT, "1", "gradient from the photograph whose subset found it"),
    "course": Layout(_VECTOR, "px", "place, or where the motion has carried it"),
    "motion": Layout(_VECTOR, "px", "last known motion of a step"),
    "way": Layout(GRID, "1", "0 the reference itself, 1 directly from it, 2 through another"),
}
_IMAGE = ("reference_row", "reference_col")
_REFERENCE_LAYOUTS = {
    "reference_image": Layout(_IMAGE, "grey level", "part of the photograph in between"),
    "reference_usable": Layout(_IMAGE, "1", "the region in it"),
    "reference_xy": Layout(_VECTOR, "px", "place in it"),
    "reference_warp": Layout(_WARP, "1", "warp from the first photograph to it"),
    "reference_passed": Layout(_SYMMETRIC, "px²", "covariance of the place by others before it"),
    "reference_slope": Layout(_GRADIENT, "1", "gradient of the motion from the one before it"),
}


class SubsetGrid(NamedTuple):
    """The grid of subsets in the first left photograph.

    step_size : distance of the points [px]
    subset_size : side of a subset [px]
    shape_function : affine or quadratic
    """

    step_size: int
    subset_size: int
    shape_function: str


class FollowedPoints(Kind):
    """Points found by their subsets in one camera's photograph of a step; arrays are (row, col, …) of the grid."""

    @property
    def grid(self) -> SubsetGrid:
        """The grid of subsets that the points belong to."""
        attrs = self.product.attrs
        return SubsetGrid(attrs["step_size"], attrs["subset_size"], attrs["shape_function"])

    @property
    def polygons(self) -> list[Polygon]:
        """Outline of the region at this step [px]."""
        return polygons_from_json(self.product.attrs["polygons"])

    def as_reference(self, image: np.ndarray) -> ReferencePhotograph:
        """The step as one whose photograph points are followed from.

        image : (row, col) — its photograph by the same camera
        """
        from dicflow.core.correlation.points import ReferencePhotograph
        from dicflow.core.photographs.region import interior

        usable = interior(self.polygons, image.shape)
        return ReferencePhotograph(image, (0, 0), usable, self["xy"], self["warp"], self["passed"], self["slope"])

    @property
    def reference_between(self) -> ReferencePhotograph | None:
        """The step in between that the points went through; None where all came from the first photograph."""
        from dicflow.core.correlation.points import ReferencePhotograph

        if "reference" not in self.product.attrs:
            return None
        facts = self.product.attrs["reference"]
        x, y = facts["origin"]
        image, usable = self["reference_image"], self["reference_usable"] > 0
        points, warp, passed, slope = (self[f"reference_{name}"] for name in ("xy", "warp", "passed", "slope"))
        return ReferencePhotograph(image, (x, y), usable, points, warp, passed, slope, facts["age"])

    def outline(self, start: Sequence[Polygon], found: FoundPoints, places: np.ndarray) -> Sequence[Polygon]:
        """The region's outline at the next step; that of this step where too few points were found there.

        start : the outline at the first step [px]
        found : points at the next step; places : (row, col, 2) — where they were at the first [px]
        """
        from dicflow.core.correlation.points import MIN_POINTS_FOR_MOTION, carried_points
        from dicflow.core.photographs.region import carry

        if found.valid.sum() < MIN_POINTS_FOR_MOTION:
            return self.polygons
        return carry(start, lambda ring: carried_points(found, places, ring))


def reference_layouts(
    reference: ReferencePhotograph | None, subset_size: int
) -> tuple[dict[str, Variable], dict[str, Any]]:
    """A reference step that is not the first, as arrays and attributes of a product; nothing for None."""
    from dicflow.core.correlation.points import cropped

    if reference is None:
        return {}, {}
    kept = cropped(reference, subset_size)
    values = {
        "reference_image": kept.image,
        "reference_usable": kept.usable.astype("uint8"),
        "reference_xy": kept.points,
        "reference_warp": kept.warp,
        "reference_passed": kept.inherited_covariance,
        "reference_slope": kept.slope,
    }
    return laid_out(_REFERENCE_LAYOUTS, values), {"reference": {"origin": list(kept.origin), "age": kept.age}}


class Correlation(FollowedPoints):
    """Points in the left photograph of a step."""

    KINDS: ClassVar = ("correlation",)

    @classmethod
    def write(
        cls,
        found: FoundPoints,
        course: Course,
        template: np.ndarray,
        noise: tuple[Noise, float],
        polygons: Sequence[Polygon],
        grid: SubsetGrid,
        reference: ReferencePhotograph | None = None,
        facts: Mapping[str, Any] | None = None,
    ) -> Product:
        """A product of points.

        course : where each point is or would be, and its last motion
        template : (row, col, 3) — covariance by the first photograph's noise [px²]
        noise : of the photographs, and as correlation feels it [grey levels]
        polygons : the region's outline at this step [px]
        reference : the step in between that points were followed from
        facts : further attributes: image_size, interpolation, summary
        """
        from dicflow.core.correlation.warp import gradient

        values: dict[str, np.ndarray] = {
            "xy": found.warp[..., 0],
            "gradient": gradient(found.warp),
            "warp": found.warp,
            "znssd": found.znssd,
            "iterations": found.iterations,
            "status": found.status,
            "covariance": found.covariance,
            "template": template,
            "passed": found.inherited_covariance,
            "slope": found.slope,
            "course": course.place.astype("f4"),
            "motion": course.motion.astype("f4"),
            "way": found.route,
        }
        carried, between = reference_layouts(reference, grid.subset_size)
        grey, level = noise
        attrs = {
            **grid._asdict(),
            "noise_grey": grey.grey,
            "noise_level": level,
            "noise_source": grey.source,
            "noise_settled": grey.is_final,
            "polygons": polygons_to_json(polygons),
        }
        return Product("correlation", {**laid_out(_LAYOUTS, values), **carried}, {**attrs, **(facts or {}), **between})

    @property
    def noise(self) -> Noise:
        """Noise of the left camera's photographs."""
        from dicflow.core.photographs.noise import Noise

        return Noise(*(self.product.attrs[f"noise_{name}"] for name in ("grey", "source", "settled")))

    @property
    def noise_level(self) -> float:
        """Noise as correlation feels it, behind the low pass [grey levels]."""
        return float(self.product.attrs["noise_level"])

    @property
    def noise_is_given(self) -> bool:
        """Whether the user gave the noise, rather than the photographs."""
        return self.product.attrs.get("noise_source") == "given"

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the photograph [px]."""
        width, height = self.product.attrs["image_size"]
        return width, height

    @property
    def course(self) -> Course:
        """Where each point is, or where the motion has carried it, and its last known motion."""
        from dicflow.core.correlation.course import Course

        return Course(*(self[name].astype(float) for name in ("course", "motion")))
