"""Material points found in the left photograph of a step, and the reference photographs of the next steps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

from dicflow.engine.product import Product, Variable
from dicflow.kinds.kind import GRID, Kind, Layout, laid_out, warned_if_lost
from dicflow.kinds.region import polygons_from_json, polygons_to_json

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.correlation.course import Course
    from dicflow.core.correlation.points import FoundPoints, ReferencePhotograph
    from dicflow.core.parts import Parts
    from dicflow.core.photographs.exposure import Photograph
    from dicflow.core.photographs.noise import Noise
    from dicflow.core.photographs.polygon import Polygon

__all__ = ["Correlation", "FollowedPoints", "SubsetGrid", "part_variables", "parts_of", "reference_variables"]

_VECTOR, _SYMMETRIC, _GRADIENT = (*GRID, "component"), (*GRID, "pair"), (*GRID, "out", "in")
_WARP = (*GRID, "component", "term")
_LAYOUTS = {
    "xy": Layout(_VECTOR, "px", "place in the left photograph"),
    "gradient": Layout(_GRADIENT, "1", "deformation gradient in the photograph"),
    "warp": Layout(_WARP, "1", "warp of the subset"),
    "znssd": Layout(GRID, "1", "ZNSSD"),
    "iterations": Layout(GRID, "1", "iterations"),
    "status": Layout(GRID, "1", "valid, or why the place is unknown"),
    "covariance": Layout(_SYMMETRIC, "px²", "covariance of the place (xx, xy, yy)"),
    "template": Layout(_SYMMETRIC, "px²", "covariance of the place by the noise of the template"),
    "template_own": Layout(_SYMMETRIC, "px²", "the same with the shape function of this step, if it is another one"),
    "misfit": Layout(_SYMMETRIC, "px²", "share of the misfit of the subset in the covariance"),
    "passed": Layout(_SYMMETRIC, "px²", "share of reference steps in the covariance; none if missing"),
    "slope": Layout(_GRADIENT, "1", "gradient of the motion from the reference photograph; as gradient if missing"),
    "course": Layout(_VECTOR, "px", "place, or the place expected by the last motion"),
    "motion": Layout(_VECTOR, "px", "last known motion of a step"),
    "part": Layout(GRID, "1", "number of the part of the region; a single part if missing"),
    "bias": Layout(_VECTOR, "px", "what the shape function leaves out of the place, as a standard deviation"),
    "way": Layout(GRID, "1", "route: 0 no value or the first photograph, 1 direct, 2 via a reference step"),
}
_PERIOD = ("period_px", "repeating_share")
_MIN_REPEATING_SHARE = 0.5
"""Share of the region that repeats itself from which displacements count as ambiguous."""
_IMAGE = ("reference_row", "reference_col")
_REFERENCE_LAYOUTS = {
    "reference_image": Layout(_IMAGE, "grey level", "part of the photograph of the reference step"),
    "reference_usable": Layout(_IMAGE, "1", "pixels in the region"),
    "reference_measured": Layout(_IMAGE, "1", "pixels that are measured; all if missing"),
    "reference_xy": Layout(_VECTOR, "px", "place in the reference step"),
    "reference_warp": Layout(_WARP, "1", "warp from the first photograph to the reference step"),
    "reference_passed": Layout(_SYMMETRIC, "px²", "covariance of that place by earlier reference steps"),
    "reference_slope": Layout(
        _GRADIENT, "1", "gradient of the motion to the reference step from its own reference photograph"
    ),
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

    def as_reference(self, image: Photograph) -> ReferencePhotograph:
        """This step as a reference photograph.

        image : its photograph by the same camera
        """
        from dicflow.core.correlation.points import ReferencePhotograph
        from dicflow.core.photographs.region import interior

        region = interior(self.polygons, image.grey.shape)
        known = self["xy"], self["warp"], self.inherited_covariance, self.slope
        return ReferencePhotograph(image, (0, 0), region, *known)

    @property
    def inherited_covariance(self) -> np.ndarray:
        """Share of reference steps in the covariance of the places (row, col, 3) [px²]."""
        return self["passed"] if "passed" in self else 0.0 * self["covariance"]

    @property
    def slope(self) -> np.ndarray:
        """Gradient of the motion from the photograph with whose subsets the points were found (row, col, 2, 2)."""
        return self["slope"] if "slope" in self else self["gradient"]

    @property
    def reference_step(self) -> ReferencePhotograph | None:
        """The reference step; None while the first photograph is enough."""
        from dicflow.core.correlation.points import ReferencePhotograph
        from dicflow.core.photographs.exposure import Photograph

        if "reference" not in self.product.attrs:
            return None
        facts = self.product.attrs["reference"]
        x, y = facts["origin"]
        measured = self["reference_measured"] > 0 if "reference_measured" in self else None
        image, region = Photograph(self["reference_image"], measured), self["reference_usable"] > 0
        points, warp, passed, slope = (self[f"reference_{name}"] for name in ("xy", "warp", "passed", "slope"))
        return ReferencePhotograph(image, (x, y), region, points, warp, passed, slope, facts["age"])

    def outline(self, start: Sequence[Polygon], found: FoundPoints, parts: Parts) -> Sequence[Polygon]:
        """The region's outline at the next step; a polygon in which too few points are found there stays where it is.

        start : the outline at the first step [px]
        found : points at the next step; parts : of the grid, with the places at the first step
        """
        from dicflow.core.correlation.points import carried_outline

        return carried_outline(start, self.polygons, found, parts)

    @property
    def parts(self) -> Parts:
        """The parts of the grid; of points at the first step."""
        return parts_of(self.product)

    def with_parts(self, parts: Parts) -> Product:
        """The product with the parts of its grid; unchanged for a single one."""
        if parts.is_single:
            return self.product
        variables = {**self.product.variables, "part": _LAYOUTS["part"](parts.number)}
        return Product(self.product.kind, variables, {**self.product.attrs, "cuts": parts.cuts.tolist()})


def reference_variables(
    reference: ReferencePhotograph | None, subset_size: int
) -> tuple[dict[str, Variable], dict[str, Any]]:
    """Arrays and attributes of a product that hold a reference step; empty for None."""
    from dicflow.core.correlation.points import cropped

    if reference is None:
        return {}, {}
    kept = cropped(reference, subset_size)
    values = {
        "reference_image": kept.image.grey,
        "reference_usable": kept.region.astype("uint8"),
        "reference_xy": kept.points,
        "reference_warp": kept.warp,
        "reference_passed": kept.inherited_covariance,
        "reference_slope": kept.slope,
    }
    if kept.image.measured is not None:
        values["reference_measured"] = kept.image.measured.astype("uint8")
    return laid_out(_REFERENCE_LAYOUTS, values), {"reference": {"origin": list(kept.origin), "age": kept.age}}


def parts_of(product: Product) -> Parts:
    """The parts of the grid of a product of points at the first step, with their places there."""
    import numpy as np

    from dicflow.core.parts import Parts, single_part

    places = product.variables["xy"].values
    if "part" not in product.variables:
        return single_part(places)
    cuts = np.array(product.attrs["cuts"], dtype=float).reshape(-1, 4)
    return Parts(product.variables["part"].values, np.ascontiguousarray(places, dtype=np.float64), cuts)


def part_variables(product: Product) -> tuple[dict[str, Variable], dict[str, Any]]:
    """Arrays and attributes that hold the parts of a product's grid; empty for a single part."""
    if "part" not in product.variables:
        return {}, {}
    return {"part": product.variables["part"]}, {"cuts": product.attrs["cuts"]}


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

        course : place of each point, or its expected place, and its last motion
        template : (row, col, 3) — covariance of the places by the noise of the template [px²]
        noise : of the photographs, and its level after the low pass [grey levels]
        polygons : the region's outline at this step [px]
        reference : the reference step; None while the first photograph is enough
        facts : further attributes: image_size, interpolation, summary, pattern of the first photograph
        """
        from dicflow.core.correlation.points import VIA_REFERENCE_STEP
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
            "misfit": found.misfit.astype("f4"),
            "course": course.place.astype("f4"),
            "motion": course.motion.astype("f4"),
            "way": found.route,
        }
        if (found.route == VIA_REFERENCE_STEP).any():
            values |= {"passed": found.inherited_covariance, "slope": found.slope}
        variables, step_attrs = reference_variables(reference, grid.subset_size)
        grey, level = noise
        attrs = {
            **grid._asdict(),
            "noise_grey": grey.grey,
            "noise_level": level,
            "noise_source": grey.source,
            "noise_settled": grey.is_final,
            "polygons": polygons_to_json(polygons),
        }
        product = Product(
            "correlation", {**laid_out(_LAYOUTS, values), **variables}, {**attrs, **(facts or {}), **step_attrs}
        )
        return warned_if_lost(product)

    def with_shape_errors(self, bias: np.ndarray, template_own: np.ndarray | None, parts: Parts) -> Product:
        """The product with what its shape function does, and the parts of its grid.

        bias : (row, col, 2) — standard deviation of what it leaves out [px]
        template_own : (row, col, 3) — covariance of the places by the noise of the template, if this is not the shape
            function of the first step [px²]
        """
        values = {"bias": bias.astype("f4"), **({} if template_own is None else {"template_own": template_own})}
        variables = {**self.product.variables, **laid_out(_LAYOUTS, values)}
        return type(self)(Product(self.product.kind, variables, self.product.attrs)).with_parts(parts)

    @property
    def shape_function(self) -> Literal["affine", "quadratic"]:
        """The shape function of the subsets at this step."""
        found: Literal["affine", "quadratic"] = self.product.attrs["shape_function"]
        return found

    @property
    def first_shape_function(self) -> Literal["affine", "quadratic"]:
        """The shape function at the first step, to which ``template`` belongs."""
        return "affine" if "template_own" in self else self.shape_function

    @property
    def noise(self) -> Noise:
        """Noise of the left camera's photographs."""
        from dicflow.core.photographs.noise import Noise

        return Noise(*(self.product.attrs[f"noise_{name}"] for name in ("grey", "source", "settled")))

    @property
    def noise_grey(self) -> float:
        """Noise of the left camera's photographs [grey levels]."""
        return float(self.product.attrs["noise_grey"])

    @property
    def noise_source(self) -> str:
        """How the noise is known, in words."""
        return str(self.product.attrs["noise_source"])

    @property
    def pattern(self) -> Mapping[str, float | None] | None:
        """Fields of :class:`dicflow.core.photographs.pattern.Pattern`, None for an unknown one; None at later steps."""
        found: Mapping[str, float | None] | None = self.product.attrs.get("pattern")
        return found

    @property
    def period_facts(self) -> dict[str, Any]:
        """Attributes that say how the first photograph's pattern repeats itself; empty if it does not."""
        return {name: self.product.attrs[name] for name in _PERIOD if name in self.product.attrs}

    @property
    def reach_px(self) -> float:
        """Longest displacement of a step that is unambiguous: half the period of a pattern that repeats [px]."""
        facts = self.period_facts
        repeats = facts.get("repeating_share", 0.0) >= _MIN_REPEATING_SHARE
        return 0.5 * float(facts["period_px"]) if repeats else math.inf

    @property
    def noise_level(self) -> float:
        """Noise after the low pass [grey levels]."""
        return float(self.product.attrs["noise_level"])

    @property
    def noise_is_given(self) -> bool:
        """Whether the user gave the noise; otherwise it was measured in the photographs."""
        return self.product.attrs.get("noise_source") == "given"

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the photograph [px]."""
        width, height = self.product.attrs["image_size"]
        return width, height

    @property
    def course(self) -> Course:
        """Place of each point, or its expected place, and its last known motion."""
        from dicflow.core.correlation.course import Course

        return Course(*(self[name].astype(float) for name in ("course", "motion")))
