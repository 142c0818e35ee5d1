"""The material points of the first photograph, found in every other one to the noise limit."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from dicflow.engine.node import At, Odd, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.correlation import Correlation, SubsetGrid
from dicflow.kinds.images import Images
from dicflow.kinds.matches import Matches
from dicflow.kinds.region import Region
from dicflow.stages._lost import lost_status, lost_warning
from dicflow.stages._subsets import SubsetSearch, photograph_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from dicflow.core.correlation.points import FoundPoints
    from dicflow.core.correlation.search import CorrelatedField, Search
    from dicflow.core.correlation.seed import Pairs
    from dicflow.core.parts import Parts
    from dicflow.core.photographs.exposure import Photograph
    from dicflow.core.photographs.noise import Noise
    from dicflow.core.photographs.pattern import Pattern
    from dicflow.core.photographs.polygon import Polygon
    from dicflow.core.photographs.repetition import Repetition

__all__ = ["Correlate", "sentence"]

_OUTLINE_STEPS = 4
"""Material steps between the points of the carried outline."""
_MAX_STRIPES_SHARE = 0.5
"""Share of the region that may show stripes."""


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


class _Previous(NamedTuple):
    """The previous step: its left photograph and the points in it."""

    image: Photograph
    points: Correlation


class Correlate(SubsetSearch):
    """Find a grid of subsets of the first left photograph in the left photograph of every step.

    Inverse compositional Gauss-Newton on ZNSSD, started from matched features if ``matches`` is given, from
    cross-correlation where these fail, and from found neighbours. Each point is searched for with its subset of the
    first photograph; if too many are lost, with that of a reference step, and from there once more with the first.
    Points that leave the frame lose their value and are searched for again when they return.
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
    impl_version: ClassVar = 7

    stage: Literal["correlate"] = "correlate"
    subset_size: Odd = parameter(31, "side of the squares that are compared; odd", unit="px", ge=5)
    step_size: int = parameter(7, "distance of the points in the first photograph", unit="px", ge=1)
    noise: Literal["auto"] | Annotated[float, Field(gt=0)] = parameter(
        "auto", "noise of the photographs, for the uncertainties; auto measures it", unit="grey levels"
    )

    def run(
        self,
        images: Product,
        images_first: Product,
        region: Product,
        images_before: Product | None = None,
        matches: Product | None = None,
        correlation_before: Product | None = None,
    ) -> Product:
        from dicflow.core.photographs.region import carry, grid_points, interior, parts_of_region
        from dicflow.core.threads import over

        chosen = Region.read(region)
        outline = carry(chosen.polygons, lambda ring: ring, spacing_px=_OUTLINE_STEPS * self.step_size)
        shown = [images] if images_before is None else [images, images_first, images_before]
        image, *earlier = over(self.thread_count, _left_photograph, shown)
        start = earlier[0] if earlier else image
        parts = parts_of_region(outline, chosen.cuts, grid_points(outline, self.step_size))
        first = _First(start, interior(chosen.polygons, start.grey.shape), outline, parts)
        if correlation_before is None:
            return self._first_step(image, first)
        previous = _Previous(earlier[-1], Correlation.read(correlation_before))
        return self._next_step(image, first, previous, None if matches is None else Matches.read(matches).pairs)

    def _first_step(self, image: Photograph, first: _First) -> Product:
        """The points in the first photograph."""
        from dicflow.core.correlation.course import Course
        from dicflow.core.correlation.search import first_photograph, points_in_first_photograph
        from dicflow.core.threads import at_once

        pattern, noise, repeats = at_once(
            self.thread_count,
            partial(_pattern, image.grey, first.region, self.subset_size),
            partial(self._first_noise, image.grey, first.measured),
            partial(_repetition, image.grey, first.measured),
        )
        search = self._search(noise.grey, first)
        start = first_photograph(image, first.region, first.parts.places, search)
        found = points_in_first_photograph(start, search)
        if not found.valid.any():
            raise StageError(self._no_subset(first.region, found.status))
        exact = found._replace(covariance=0.0 * found.covariance)
        place = exact.warp[..., 0]
        product = Correlation.write(
            exact,
            Course(place, 0.0 * place),
            found.covariance,
            (noise, search.noise),
            first.outline,
            self._grid(),
            facts={
                **self._facts(exact, noise, image, first.outline),
                **_repetition_facts(repeats),
                "pattern": pattern._asdict(),
            },
        )
        return Correlation.read(product).with_parts(first.parts)

    def _next_step(self, image: Photograph, first: _First, previous: _Previous, pairs: Pairs | None) -> Product:
        """The points in every other photograph."""
        import numpy as np

        from dicflow.core.correlation.course import next_course
        from dicflow.core.correlation.material import follow_step, search_directly
        from dicflow.core.correlation.search import first_photograph
        from dicflow.core.status import Status

        course, status, template = previous.points.course, previous.points["status"], previous.points["template"]
        lost = np.asarray(np.isnan(course.place).any(axis=-1))
        grid = np.where(lost[..., None], np.nan, first.parts.places)
        reference_step, last = previous.points.reference_step, previous.points.as_reference(previous.image)
        before = noise = previous.points.noise
        jumps = np.asarray(status == Status.DISCONTINUITY)
        search = self._search(before.grey, first)._replace(reach_px=previous.points.reach_px, jumps=jumps)
        start = first_photograph(first.image, first.region, grid, search)
        direct = search_directly(start, reference_step, last, image, search, pairs)
        if not before.is_final:
            noise = self._measured_noise(before, direct.correlation, first, image.grey)
            search = search._replace(noise=self._level(noise.grey, first))
            template = (noise.grey / before.grey) ** 2 * template
        found, reference = follow_step(
            start, reference_step, direct, search, self.reference.updating(), course.expected
        )
        found = found._replace(status=np.where(lost, status, found.status))
        found, said = (found, {}) if found.valid.any() else _all_lost(found, image.grey)
        polygons = previous.points.outline(first.outline, found, first.parts)
        product = Correlation.write(
            found,
            next_course(course, last.points, found.warp[..., 0]),
            template,
            (noise, search.noise),
            polygons,
            self._grid(),
            reference,
            {**self._facts(found, noise, image, polygons), **previous.points.period_facts, **said},
        )
        return Correlation.read(product).with_parts(first.parts)

    def _grid(self) -> SubsetGrid:
        return SubsetGrid(self.step_size, self.subset_size, self.shape_function)

    def _search(self, noise: float, first: _First) -> Search:
        """noise : of the photographs [grey levels]"""
        return self.search(self.subset_size, self._level(noise, first))._replace(parts=first.parts)

    def _level(self, noise: float, first: _First) -> float:
        """The noise after the low pass [grey levels]. noise : before it"""
        from dicflow.core.photographs.noise import smoothed_noise

        return smoothed_noise(noise, first.image.grey, first.measured, self.smoothing)

    def _first_noise(self, image: np.ndarray, measured: np.ndarray) -> Noise:
        """The noise that is given, or estimated from the first photograph."""
        from dicflow.core.photographs.noise import Noise, noise_of_first_photograph

        return noise_of_first_photograph(image, measured) if self.noise == "auto" else Noise(self.noise, "given", True)

    def _measured_noise(self, noise: Noise, correlation: CorrelatedField, first: _First, image: np.ndarray) -> Noise:
        """The noise, measured in the first photograph and this one."""
        from dicflow.core.correlation.edges import residual_variance
        from dicflow.core.photographs.noise import interpolated_variance, noise_from_pair
        from dicflow.core.status import Status

        field = correlation.field
        valid = field.status == Status.VALID
        residual = residual_variance(field)[valid] / correlation.damping.residual(
            interpolated_variance(self.spline_degree)
        )
        return noise_from_pair(
            noise,
            first.image.grey,
            image,
            first.measured,
            (correlation.centres[valid], field.warp[valid][..., 0], residual),
            degree=self.spline_degree,
            smoothing_px=self.smoothing,
        )

    def _no_subset(self, region: np.ndarray, status: np.ndarray) -> str:
        """The message if no subset of the first photograph can be followed."""
        import cv2

        from dicflow.core.status import Status

        if (status == Status.OVEREXPOSED).sum() > (status == Status.CUT_SUBSET).sum():
            return (
                f"no subset of {self.subset_size} px has enough pixels that are neither white nor black nor hidden in "
                "the first left photograph; change the exposure, or take a larger subset_size"
            )
        _, _, width, height = cv2.boundingRect(region.astype("uint8"))
        return (
            f"no subset of {self.subset_size} px has {self.min_share:.0%} of its pixels inside the region "
            f"({width} × {height} px); take a subset_size of {max(5, min(width, height) // 2) | 1} px, or a larger "
            "region"
        )

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
            "summary": _summary(found, noise, overexposed),
        }


def _summary(found: FoundPoints, noise: Noise, overexposed: float) -> dict[str, Any]:
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


def _left_photograph(images: Product) -> Photograph:
    return photograph_of(Images.read(images), "left")


def _pattern(image: np.ndarray, usable: np.ndarray, subset_size: int) -> Pattern:
    """The pattern of the first photograph. Raises StageError unless it distinguishes subsets."""
    from dicflow.core.photographs.pattern import checked_pattern

    try:
        return checked_pattern(image, usable, subset_size, "the first left photograph")
    except ValueError as error:
        raise StageError(str(error)) from error


def _repetition(image: np.ndarray, region: np.ndarray) -> Repetition:
    """How the pattern repeats itself. Raises StageError for stripes."""
    from dicflow.core.photographs.repetition import repetition

    found = repetition(image, region)
    if found.stripes_share > _MAX_STRIPES_SHARE:
        raise StageError(
            f"{found.stripes_share:.0%} of the region shows stripes in the first left photograph, and a displacement "
            "along them cannot be measured; apply random speckles"
        )
    return found


def _repetition_facts(found: Repetition) -> dict[str, Any]:
    """Attributes of a pattern that repeats itself; empty for any other."""
    if not found.share > 0.0:
        return {}
    text = (
        f"the pattern repeats every {found.period_px:.1f} px in {found.share:.0%} of the region: a displacement beyond "
        f"{0.5 * found.period_px:.1f} px from one step to the next looks the same as a shorter one; apply random "
        "speckles, or photograph smaller steps"
    )
    return {"period_px": found.period_px, "repeating_share": found.share, "warnings": [text]}


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
        f"{stage.shape_function} shape functions and {degree} B-splines as the interpolant [unser1999]; points with a "
        f"ZNSSD above {stage.max_znssd:g} were discarded."
    )
    if stage.reference.update != "never":
        text += " Where too many points were lost, a later photograph served as an intermediate reference."
    if product is None:
        return text
    grey = Correlation.read(product).noise_grey
    return f"{text} The image noise of {grey:.2g} grey levels was propagated to the places of the points [pan2008]."
