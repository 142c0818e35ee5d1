"""The material points of the first photograph, found in every other one to the noise limit."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from dicflow.engine.node import At, Joined, Odd, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.correlation import Correlation, SubsetGrid
from dicflow.kinds.images import Images
from dicflow.kinds.matches import Matches
from dicflow.kinds.region import Region
from dicflow.stages._lost import lost_status, lost_warning, no_subset
from dicflow.stages._parameters import large_subset
from dicflow.stages._pattern import pattern_of_region, repetition_facts, repetition_of_region
from dicflow.stages._shape import left_out, needed_shape
from dicflow.stages._step_summary import step_summary
from dicflow.stages._subsets import ShapeFunction, SubsetSearch, photograph_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy as np

    from dicflow.core.correlation.course import Course
    from dicflow.core.correlation.points import FoundPoints, ReferencePhotograph
    from dicflow.core.correlation.search import CorrelatedField, Search
    from dicflow.core.correlation.seed import Pairs
    from dicflow.core.parts import Parts
    from dicflow.core.photographs.exposure import Photograph
    from dicflow.core.photographs.noise import Noise
    from dicflow.core.photographs.polygon import Polygon

__all__ = ["Correlate", "sentence"]

_OUTLINE_STEPS = 4
"""Material steps between the points of the carried outline."""
_SHAPES = {"auto": "affine, or where these would be biased quadratic,", "affine": "affine", "quadratic": "quadratic"}


class _First(NamedTuple):
    """The first left photograph and what is measured in it.

    region : (row, col) — its pixels inside the region
    outline : of the region [px]
    parts : of the grid, with the places of its points
    """

    image: Photograph
    region: np.ndarray
    outline: Sequence[Polygon]
    parts: Parts

    @property
    def measured(self) -> np.ndarray:
        """Pixels (row, col) inside the region that are measured."""
        return self.region if self.image.measured is None else self.region & self.image.measured


class _Ready(NamedTuple):
    """What a search needs beside the photograph that it looks at.

    first : the first left photograph
    points : of the previous step
    course : of them, from step to step
    lost : (row, col) — points that are lost for good
    search : with the shape function and the noise of the previous step
    last, start : the previous and the first left photograph as reference photographs
    """

    first: _First
    points: Correlation
    course: Course
    lost: np.ndarray
    search: Search
    last: ReferencePhotograph
    start: ReferencePhotograph


class _Searched(NamedTuple):
    """The points found at a step.

    noise : of the photographs
    template : (row, col, 3) — covariance of the places by the noise of the template, with the shape function of the
        first step [px²]
    reference : the reference step for the next photograph
    bias : (row, col, 2) — standard deviation of what the shape function leaves out [px]; None if it is not known yet
    """

    found: FoundPoints
    search: Search
    noise: Noise
    template: np.ndarray
    reference: ReferencePhotograph | None
    bias: np.ndarray | None


class Correlate(SubsetSearch):
    """Find a grid of subsets of the first left photograph in the left photograph of every step.

    Inverse compositional Gauss-Newton on ZNSSD, started from matched features if ``matches`` is given, from
    cross-correlation where these fail, and from found neighbours. Each point is searched for with its subset of the
    first photograph; if too many are lost, with that of a reference step, and from there once more with the first.
    Points that leave the frame lose their value and are searched for again when they return.

    ``shape_function: auto`` takes affine subsets, and quadratic ones at steps where affine ones would clearly be wrong
    by more than a third of their standard deviation in more than 3 % of the points.
    """

    title: ClassVar = "correlate in time"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {
        "images": Port("images", "plane"),
        "images_first": Port("images", "plane", at=At.FIRST),
        "images_before": Port("images", "plane", at=At.PREVIOUS),
        "region": Port("region"),
        "matches": Port("matches", optional=True),
        "correlation_before": Port("correlation", at=At.PREVIOUS, own=True),
    }
    gives: ClassVar = "correlation"
    impl_version: ClassVar = 10

    stage: Literal["correlate"] = "correlate"
    shape_function: Literal["auto"] | ShapeFunction = parameter(
        "auto", "how a subset may deform; auto takes affine subsets, and quadratic ones at steps that need them"
    )
    subset_size: Odd = parameter(31, "side of the squares that are compared; odd", unit="px", ge=5)
    step_size: int = parameter(7, "distance of the points in the first photograph", unit="px", ge=1)
    noise: Literal["auto"] | Annotated[float, Field(gt=0)] = parameter(
        "auto", "noise of the photographs, for the uncertainties; auto measures it", unit="grey levels"
    )

    def problems(self, joined: Mapping[str, Joined]) -> Iterator[tuple[str, str]]:
        return large_subset(self.subset_size, joined["images"])

    def run(
        self,
        images: Product,
        images_first: Product,
        region: Product,
        images_before: Product | None = None,
        matches: Product | None = None,
        correlation_before: Product | None = None,
    ) -> Product:
        from dicflow.core.threads import at_once

        if correlation_before is None or images_before is None:
            return self._first_step(self._first(images_first, region))
        points = Correlation.read(correlation_before)
        image, first, last = at_once(
            self.thread_count,
            partial(_left_photograph, images),
            partial(self._first, images_first, region),
            partial(_as_reference, points, images_before),
        )
        pairs = None if matches is None else Matches.read(matches).pairs
        return self._next_step(image, self._ready(first, points, last), pairs)

    def _first(self, images: Product, region: Product) -> _First:
        """The first left photograph, and the grid of points in its region."""
        from dicflow.core.photographs.region import carry, grid_points, interior, parts_of_region

        chosen, image = Region.read(region), _left_photograph(images)
        outline = carry(chosen.polygons, lambda ring: ring, spacing_px=_OUTLINE_STEPS * self.step_size)
        parts = parts_of_region(outline, chosen.cuts, grid_points(outline, self.step_size))
        return _First(image, interior(chosen.polygons, image.grey.shape), outline, parts)

    def _first_step(self, first: _First) -> Product:
        """The points in the first photograph."""
        from dicflow.core.correlation.course import Course
        from dicflow.core.correlation.search import first_photograph, points_in_first_photograph
        from dicflow.core.threads import at_once

        shape: ShapeFunction = "affine" if self.shape_function == "auto" else self.shape_function
        search, image = self.search(self.subset_size, 1.0, shape)._replace(parts=first.parts), first.image
        start = first_photograph(image, first.region, first.parts.places, search)
        pattern, of_unit_noise, noise, repeats = at_once(
            self.thread_count,
            partial(pattern_of_region, image.grey, first.region, self.subset_size),
            partial(points_in_first_photograph, start, search),
            partial(self._first_noise, image.grey, first.measured),
            partial(repetition_of_region, image.grey, first.measured),
        )
        level = self._level(noise.grey, first)
        covariance = level**2 * of_unit_noise.covariance
        found = of_unit_noise._replace(covariance=covariance, template_covariance=covariance)
        if not found.valid.any():
            raise StageError(no_subset(first.region, found.status, self.subset_size, self.min_share))
        exact = found._replace(covariance=0.0 * found.covariance)
        place = exact.warp[..., 0]
        product = Correlation.write(
            exact,
            Course(place, 0.0 * place),
            found.covariance,
            (noise, level),
            first.outline,
            self._grid(shape),
            facts={
                **self._facts(exact, noise, image, first.outline),
                **repetition_facts(repeats),
                "pattern": pattern._asdict(),
            },
        )
        return Correlation.read(product).with_parts(first.parts)

    def _ready(self, first: _First, points: Correlation, last: ReferencePhotograph) -> _Ready:
        """What the search of a step needs beside its photograph."""
        import numpy as np

        from dicflow.core.arrays import all_finite
        from dicflow.core.correlation.search import first_photograph
        from dicflow.core.status import Status

        course = points.course
        lost = ~all_finite(course.place)
        grid = np.where(lost[..., None], np.nan, first.parts.places)
        search = self._search(points.noise.grey, first, self._usual_shape(points))._replace(reach_px=points.reach_px)
        search = search._replace(jumps=points["status"] == Status.DISCONTINUITY)
        start = first_photograph(first.image, first.region, grid, search)
        return _Ready(first, points, course, lost, search, last, start)

    def _next_step(self, image: Photograph, ready: _Ready, pairs: Pairs | None) -> Product:
        """The points in every other photograph."""
        import numpy as np

        from dicflow.core.correlation.course import next_course
        from dicflow.core.threads import at_once

        first, before = ready.first, ready.points
        searched = self._searched(image, ready, pairs)
        found = searched.found
        found = found._replace(status=np.where(ready.lost, before["status"], found.status))
        found, said = (found, {}) if found.valid.any() else _all_lost(found, image.grey)
        shape, threads = searched.search.subset.shape_function, self.thread_count

        def followed() -> tuple[Sequence[Polygon], dict[str, Any], Course]:
            polygons = before.outline(first.outline, found, first.parts)
            course = next_course(ready.course, before["xy"], found.warp[..., 0])
            return polygons, self._facts(found, searched.noise, image, polygons), course

        with_bias = partial(self._left_out, searched, shape, first, threads)
        bias, (polygons, facts, course) = at_once(threads, with_bias, followed)
        product = Correlation.write(
            found,
            course,
            searched.template,
            (searched.noise, searched.search.noise),
            polygons,
            self._grid(shape),
            searched.reference,
            {**facts, **before.period_facts, **said},
        )
        own = found.template_covariance if shape != before.first_shape_function else None
        return Correlation.read(product).with_shape_errors(bias, own, first.parts)

    def _left_out(self, searched: _Searched, shape: str, first: _First, threads: int) -> np.ndarray:
        """What the shape function leaves out of the places (row, col, 2) [px]."""
        if searched.bias is not None:
            return searched.bias
        return left_out(searched.found, shape, (self.subset_size, self.step_size), first.parts, threads)

    def _searched(self, image: Photograph, ready: _Ready, pairs: Pairs | None) -> _Searched:
        """The points that were not lost for good, with the shape function that they need."""
        from dicflow.core.correlation.material import follow_step, search_again, search_directly
        from dicflow.core.correlation.search import first_photograph

        first, points, search, start = ready.first, ready.points, ready.search, ready.start
        before = noise = points.noise
        reference_step = points.reference_step
        direct = search_directly(start, reference_step, ready.last, image, search, pairs)
        if not before.is_final:
            noise = self._measured_noise(before, (direct.correlation, start.origin, search), first, image.grey)
            search = search._replace(noise=self._level(noise.grey, first))
        updating, expected = self.reference.updating(), ready.course.expected
        found, reference = follow_step(start, reference_step, direct, search, updating, expected)
        used, grid_px = search.subset.shape_function, (self.subset_size, self.step_size)
        is_open = self.shape_function == "auto"
        shape, bias = needed_shape(found, used, grid_px, first.parts, self.thread_count) if is_open else (used, None)
        if shape != used:
            search = search._replace(subset=search.subset._replace(shape_function=shape))
            start = first_photograph(first.image, first.region, start.points, search)
            direct = search_again(start, direct, found, search)
            if not before.is_final:
                noise = self._measured_noise(before, (direct.correlation, start.origin, search), first, image.grey)
                search = search._replace(noise=self._level(noise.grey, first))
            found, reference = follow_step(start, reference_step, direct, search, updating, expected)
        template = (noise.grey / before.grey) ** 2 * points["template"]
        return _Searched(found, search, noise, template, reference, bias)

    def _usual_shape(self, points: Correlation) -> ShapeFunction:
        """The shape function with which a step is searched: as at the previous step, if it is not given."""
        return points.shape_function if self.shape_function == "auto" else self.shape_function

    def _grid(self, shape_function: str) -> SubsetGrid:
        return SubsetGrid(self.step_size, self.subset_size, shape_function)

    def _search(self, noise: float, first: _First, shape_function: ShapeFunction) -> Search:
        """noise : of the photographs [grey levels]"""
        return self.search(self.subset_size, self._level(noise, first), shape_function)._replace(parts=first.parts)

    def _level(self, noise: float, first: _First) -> float:
        """The noise after the low pass [grey levels]. noise : before it"""
        from dicflow.core.photographs.noise import smoothed_noise

        return smoothed_noise(noise, first.image.grey, first.measured, self.smoothing)

    def _first_noise(self, image: np.ndarray, measured: np.ndarray) -> Noise:
        """The noise that is given, or estimated from the first photograph."""
        from dicflow.core.photographs.noise import Noise, noise_of_first_photograph

        return noise_of_first_photograph(image, measured) if self.noise == "auto" else Noise(self.noise, "given", True)

    def _measured_noise(
        self,
        noise: Noise,
        direct: tuple[CorrelatedField, tuple[int, int], Search],
        first: _First,
        image: np.ndarray,
    ) -> Noise:
        """The noise, measured in the first photograph and this one.

        direct : subsets of the first photograph found in this one, the origin of their template [px], and their search
        """
        from dicflow.core.correlation.place_noise import noise_of_places
        from dicflow.core.correlation.search import noise_of_residual
        from dicflow.core.photographs.noise import noise_from_pair
        from dicflow.core.threads import at_once

        views, size = (first.image.grey, image, first.measured), self.subset_size
        by_places, points = at_once(
            self.thread_count,
            partial(noise_of_places, *direct),
            partial(noise_of_residual, direct[0], self.spline_degree, size),
        )
        return noise_from_pair(noise, *views, points, by_places, pixels=size**2, smoothing_px=self.smoothing)

    def _facts(
        self, found: FoundPoints, noise: Noise, image: Photograph, polygons: Sequence[Polygon]
    ) -> dict[str, Any]:
        """Further attributes of a step."""
        from dicflow.core.photographs.region import interior
        from dicflow.core.photographs.texture import saturated_share

        height, width = image.grey.shape
        overexposed = saturated_share(image.grey, interior(polygons, image.grey.shape))
        return {
            "interpolation": self.interpolation,
            "image_size": [width, height],
            "summary": step_summary(found, noise, overexposed),
        }


def _as_reference(points: Correlation, images: Product) -> ReferencePhotograph:
    return points.as_reference(_left_photograph(images))


def _left_photograph(images: Product) -> Photograph:
    return photograph_of(Images.read(images), "left")


def _all_lost(found: FoundPoints, image: np.ndarray) -> tuple[FoundPoints, dict[str, Any]]:
    """Points that were all lost, with the reason, and the attribute with the warning."""
    from dicflow.core.status import Status

    reasons = (Status.UNTRACKED, Status.NOT_CONVERGED, Status.LOW_CORRELATION, Status.OVEREXPOSED)
    status = lost_status(found.status, image, reasons)
    return found._replace(status=status), {"warnings": [lost_warning(image, "left")]}


def sentence(stage: Correlate, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    size, weight = stage.subset_size, f", weighted by a Gaussian of σ {stage.gaussian:g} px," if stage.gaussian else ""
    low_pass = f" after a Gaussian low pass of σ {stage.smoothing:g} px" if stage.smoothing else ""
    degree = {"bicubic": "cubic", "biquintic": "quintic"}[stage.interpolation]
    text = (
        f"Subsets of {size} × {size} px{weight} of the first photograph, at a step size of {stage.step_size} px, were "
        f"found in the photograph of every step{low_pass} by inverse compositional Gauss-Newton iterations "
        f"[baker2004, pan2013] on the zero-mean normalised sum of squared differences (ZNSSD), with "
        f"{_SHAPES[stage.shape_function]} shape functions and {degree} B-splines as the interpolant [unser1999]; "
        f"points with a ZNSSD above {stage.max_znssd:g} were discarded."
    )
    if stage.reference.update != "never":
        text += " Where too many points were lost, a later photograph served as an intermediate reference."
    if product is None:
        return text
    grey = Correlation.read(product).noise_grey
    return f"{text} The image noise of {grey:.2g} grey levels was propagated to the places of the points [pan2008]."
