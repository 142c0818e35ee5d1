"""The material points of the first photograph found in every other, to the noise limit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

from dicflow.engine.node import At, Node, Odd, Pixels, Port, Scope, parameter
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from dicflow.core.correlation.course import Course
    from dicflow.core.correlation.material import Anchor, Followed, Search, Updating
    from dicflow.core.photographs.noise import Noise
    from dicflow.core.photographs.region import Polygon

__all__ = ["Correlate", "anchor_of", "carried_outline", "carried_reference", "packed", "updating"]

OUTLINE_STEPS = 4  # material steps between the points of the carried outline
DEGREES = {"bicubic": 3, "biquintic": 5}
GRID = ("row", "col")

_PASSED_ON = ("gaussian", "min_share", "max_iterations", "tolerance", "smoothing", "misfit")
"""Parameters that the stage stereo takes over."""


class Reference(BaseModel):
    """When points are followed from a photograph in between."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    update: Literal["on_demand", "every", "never"] = parameter(
        "on_demand", "take a new reference for lost points when there are too many, every so many steps, or never"
    )
    steps: int = parameter(10, "for every: after how many steps", ge=1)
    lost: float = parameter(0.002, "share of points lost since the step before that asks for a reference", ge=0, le=1)
    znssd: float = parameter(0.1, "median ZNSSD against a reference above which a newer one is taken", gt=0, le=4)


class Correlate(Node):
    """Find a grid of subsets of the first left photograph in the left photograph of every step.

    Inverse compositional Gauss-Newton on ZNSSD, started from the features that ``matches`` brings where there are such,
    from cross-correlation where they fail, and from what neighbours found. Each point is looked for with its subset
    of the first photograph; where too many are lost, through a reference in between, from which it is then tried
    directly once more. Points that leave the frame lose their value and are looked for again when they return.
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
    impl_version: ClassVar = 4

    stage: Literal["correlate"] = "correlate"
    subset_size: Odd = parameter(31, "side of the squares that are compared; odd", unit="px", ge=5)
    step_size: int = parameter(7, "distance of the points in the first photograph", unit="px", ge=1)
    shape_function: Literal["affine", "quadratic"] = parameter("affine", "how a subset may deform")
    interpolation: Literal["bicubic", "biquintic"] = parameter("biquintic", "spline between the pixels")
    gaussian: Pixels = parameter(
        0.0, "standard deviation of the weight of a subset's pixels; 0 for equal ones", unit="px", ge=0
    )
    max_znssd: float = parameter(
        0.3, "what fits worse than this is lost (the zero-mean cross-correlation is 1 − ZNSSD/2)", gt=0, le=4
    )
    min_share: float = parameter(0.4, "share of a subset's pixels that must lie in the region", gt=0, le=1)
    max_iterations: int = parameter(30, "of the Gauss-Newton search", ge=1)
    tolerance: float = parameter(
        1e-3,
        "what may be left to correct in a subset when the search ends; the arithmetic does not reach less than 1e-5",
        unit="px",
        ge=1e-5,
    )
    smoothing: Pixels = parameter(
        0.0, "standard deviation of a Gaussian low pass against the bias of interpolation; 0 for none", unit="px", ge=0
    )
    noise: Literal["auto"] | Annotated[float, Field(gt=0)] = parameter(
        "auto", "noise of the photographs, for the uncertainties; auto measures it", unit="grey levels"
    )
    misfit: bool = parameter(
        True, "judge the uncertainties by what subsets differ by beyond the noise too: patterns too sharp, or changed"
    )
    reference: Reference = parameter(Reference(), "when points are followed from a photograph in between")
    threads: int = parameter(1, "threads that share the points of a step", affects="speed", ge=1)

    def run(
        self,
        images: Product,
        images_first: Product,
        region: Product,
        images_before: Product | None = None,
        matches: Product | None = None,
        correlation_before: Product | None = None,
    ) -> Product:
        from dicflow.core.photographs.region import carry, interior
        from dicflow.kinds.region import polygons_from_json

        polygons = polygons_from_json(region.attrs["polygons"])
        outline = carry(polygons, lambda ring: ring, spacing_px=OUTLINE_STEPS * self.step_size)
        usable = interior(polygons, images_first["left"].shape)
        if correlation_before is None or images_before is None:
            return self._first(images["left"], usable, outline)
        return self._next(images, images_first, images_before, usable, outline, matches, correlation_before)

    def _first(self, image: np.ndarray, usable: np.ndarray, outline: Sequence[Polygon]) -> Product:
        """The points in the first photograph."""
        from dicflow.core.correlation.course import Course
        from dicflow.core.correlation.material import at_rest, first_anchor
        from dicflow.core.photographs.noise import Noise, first_noise
        from dicflow.core.photographs.region import grid_points

        _check_photograph(image, usable, self.subset_size)
        noise = first_noise(image, usable) if self.noise == "auto" else Noise(self.noise, "given", True)
        search = self._search(noise.grey, image, usable)
        found = at_rest(first_anchor(image, usable, grid_points(outline, self.step_size), search), search)
        if not found.valid.any():
            raise StageError(self._too_large(usable))
        here = found._replace(covariance=0.0 * found.covariance)
        place = here.warp[..., 0]
        course = Course(place, 0.0 * place)
        return self._product(here, course, image, outline, noise, search.noise, found.covariance, None)

    def _next(
        self,
        images: Product,
        images_first: Product,
        images_before: Product,
        usable: np.ndarray,
        outline: Sequence[Polygon],
        matches: Product | None,
        before: Product,
    ) -> Product:
        """The points in every other photograph."""
        import numpy as np

        from dicflow.core.correlation.course import Course, carried_on
        from dicflow.core.correlation.material import first_anchor, follow_step
        from dicflow.core.correlation.seed import Pairs
        from dicflow.core.photographs.noise import Noise
        from dicflow.core.photographs.region import grid_points

        image, start = images["left"], images_first["left"]
        noise = Noise(*(before.attrs[f"noise_{name}"] for name in ("grey", "source", "settled")))
        hopeless = _hopeless(before)
        grid = np.where(hopeless[..., None], np.nan, grid_points(outline, self.step_size))
        pairs = None if matches is None else Pairs(*(matches[n].astype(float) for n in ("reference", "deformed")))
        carried, last = carried_reference(before), anchor_of(before, images_before["left"])
        course = Course(*(before[name].astype(float) for name in ("course", "motion")))

        def follow(level: float) -> tuple[Followed, Anchor | None]:
            search = self._search(level, start, usable)
            first = first_anchor(start, usable, grid, search)
            return follow_step(first, carried, last, image, search, updating(self.reference), pairs, course.expected)

        found, reference = follow(noise.grey)
        template = before["template"]
        if not noise.settled:
            told = self._told(noise, found, grid, start, image, usable)
            template = (told.grey / noise.grey) ** 2 * template
            found, reference = (found, reference) if told.grey == noise.grey else follow(told.grey)
            noise = told
        found = found._replace(status=np.where(hopeless, before["status"], found.status))
        level = self._search(noise.grey, start, usable).noise
        polygons, course = (
            carried_outline(outline, found, grid, before),
            carried_on(course, last.points, found.warp[..., 0]),
        )
        return self._product(found, course, image, polygons, noise, level, template, reference)

    def _search(self, noise: float, image: np.ndarray, usable: np.ndarray) -> Search:
        from dicflow.core.correlation.material import Search
        from dicflow.core.correlation.subsets import Subset
        from dicflow.core.photographs.noise import smoothed_noise

        subset = Subset(
            self.subset_size,
            self.shape_function,
            self.gaussian,
            self.min_share,
            self.max_iterations,
            self.tolerance,
        )
        return Search(
            subset,
            DEGREES[self.interpolation],
            self.smoothing,
            self.max_znssd,
            smoothed_noise(noise, image, usable, self.smoothing),
            threads=self.threads,
            counts_misfit=self.misfit,
        )

    def _told(
        self, noise: Noise, found: Followed, grid: np.ndarray, start: np.ndarray, image: np.ndarray, usable: np.ndarray
    ) -> Noise:
        """The noise as the first photograph and this one tell it."""
        from dicflow.core.photographs.noise import told_by_motion

        valid = found.valid
        points = grid[valid], found.warp[valid][..., 0], found.znssd[valid]
        size, degree = self.subset_size, DEGREES[self.interpolation]
        return told_by_motion(
            noise, start, image, usable, points, size=size, degree=degree, smoothing_px=self.smoothing
        )

    def _too_large(self, usable: np.ndarray) -> str:
        import cv2

        _, _, width, height = cv2.boundingRect(usable.astype("uint8"))
        return (
            f"a subset of {self.subset_size} px lies nowhere by {self.min_share:.0%} in the region of "
            f"{width} × {height} px; take a subset_size of {max(5, min(width, height) // 2) | 1} px or a larger region"
        )

    def _product(
        self,
        found: Followed,
        course: Course,
        image: np.ndarray,
        polygons: Sequence[Polygon],
        noise: Noise,
        level: float,
        template: np.ndarray,
        reference: Anchor | None,
    ) -> Product:
        """level : of the noise as correlation feels it [grey levels]"""
        from dicflow.core.correlation.warp import gradient
        from dicflow.core.photographs.region import interior
        from dicflow.core.photographs.texture import saturated_share
        from dicflow.kinds.region import polygons_to_json

        pixel, tensor = ("component",), ("pair",)
        variables = {
            "xy": _variable(found.warp[..., 0], "px", "place in the left photograph", pixel),
            "gradient": _variable(gradient(found.warp), "1", "deformation gradient in the photograph", ("out", "in")),
            "warp": _variable(found.warp, "1", "warp of the subset", ("component", "term")),
            "znssd": _variable(found.znssd, "1", "ZNSSD"),
            "iterations": _variable(found.iterations, "1", "iterations"),
            "status": _variable(found.status, "1", "why a point has a place, or has none"),
            "covariance": _variable(found.covariance, "px²", "covariance of the place (xx, xy, yy)", tensor),
            "template": _variable(template, "px²", "covariance by the first photograph's noise", tensor),
            "passed": _variable(found.passed, "px²", "share of photographs in between in the covariance", tensor),
            "slope": _variable(found.slope, "1", "gradient from the photograph whose subset found it", ("out", "in")),
            "course": _variable(course.place.astype("f4"), "px", "place, or where the motion has carried it", pixel),
            "motion": _variable(course.motion.astype("f4"), "px", "last known motion of a step", pixel),
            "way": _variable(found.way, "1", "0 the reference itself, 1 directly from it, 2 through another"),
        }
        height, width = image.shape
        overexposed = saturated_share(image, interior(polygons, image.shape))
        attrs: dict[str, Any] = {
            "step_size": self.step_size,
            "subset_size": self.subset_size,
            "shape_function": self.shape_function,
            "interpolation": self.interpolation,
            **{name: getattr(self, name) for name in _PASSED_ON},
            "image_size": [width, height],
            "noise_grey": noise.grey,
            "noise_level": level,
            "noise_source": noise.source,
            "noise_settled": noise.settled,
            "updating": self.reference.model_dump(),
            "polygons": polygons_to_json(polygons),
            "summary": _summary(found, noise, overexposed),
        }
        if reference is not None:
            carried, attrs["reference"] = packed(reference, self.subset_size)
            variables.update(carried)
        return Product("correlation", variables, attrs)


def _variable(values: np.ndarray, units: str, long_name: str, beyond: tuple[str, ...] = ()) -> Variable:
    return Variable((*GRID, *beyond), values, units, long_name)


def _summary(found: Followed, noise: Noise, overexposed: float) -> dict[str, Any]:
    """Scalars of a step; null where no point has a value.

    overexposed : share of the region's pixels; NaN where none of it is in the photograph
    """
    import numpy as np

    from dicflow.core.status import Status

    valid = found.valid
    wanted = valid | (found.status != Status.OUTSIDE) | np.isfinite(found.znssd)

    def middle(values: np.ndarray) -> float | None:
        return float(np.median(values[valid])) if valid.any() else None

    return {
        "points": int(valid.sum()),
        "valid_share": float(valid.sum() / max(int(wanted.sum()), 1)),
        "chained_points": int((found.way == 2).sum()),
        "znssd": middle(found.znssd),
        "iterations": middle(found.iterations),
        "noise_grey": noise.grey,
        "overexposed_share": overexposed if np.isfinite(overexposed) else None,
    }


def carried_outline(
    outline: Sequence[Polygon], found: Followed, grid: np.ndarray, before: Product
) -> Sequence[Polygon]:
    """The region's outline at this step; that of the step before where too little was found."""
    from dicflow.core.correlation.material import FEW, carried_by
    from dicflow.core.photographs.region import carry
    from dicflow.kinds.region import polygons_from_json

    if found.valid.sum() < FEW:
        return polygons_from_json(before.attrs["polygons"])
    return carry(outline, lambda ring: carried_by(found, grid, ring))


def updating(reference: Reference) -> Updating:
    """When a new reference is taken."""
    from dicflow.core.correlation.material import Updating

    every = reference.steps if reference.update == "every" else 0
    return Updating(reference.update != "never", reference.lost, reference.znssd, every)


def _hopeless(before: Product) -> np.ndarray:
    """Points (rows, cols) whose subset of the first photograph can never be followed."""
    import numpy as np

    from dicflow.core.status import Status

    return np.isin(before["status"], (Status.CUT_SUBSET, Status.LOW_TEXTURE))


def anchor_of(before: Product, image: np.ndarray) -> Anchor:
    """A step whose photograph is to follow points from."""
    from dicflow.core.correlation.material import Anchor
    from dicflow.core.photographs.region import interior
    from dicflow.kinds.region import polygons_from_json

    usable = interior(polygons_from_json(before.attrs["polygons"]), image.shape)
    return Anchor(image, (0, 0), usable, before["xy"], before["warp"], before["passed"], before["slope"])


def packed(reference: Anchor, subset_size: int) -> tuple[dict[str, Variable], dict[str, Any]]:
    """A reference that is not the first photograph, as arrays and attributes of a product."""
    from dicflow.core.correlation.material import cropped

    kept = cropped(reference, subset_size)
    image = ("reference_row", "reference_col")
    variables = {
        "reference_image": Variable(image, kept.image, "grey level", "part of the photograph in between"),
        "reference_usable": Variable(image, kept.usable.astype("uint8"), "1", "the region in it"),
        "reference_xy": _variable(kept.points, "px", "place in it", ("component",)),
        "reference_warp": _variable(kept.warp, "1", "warp from the first photograph to it", ("component", "term")),
        "reference_passed": _variable(kept.passed, "px²", "covariance of the place by others before it", ("pair",)),
        "reference_slope": _variable(kept.slope, "1", "gradient of the motion from the one before it", ("out", "in")),
    }
    return variables, {"origin": list(kept.origin), "age": kept.age}


def carried_reference(before: Product) -> Anchor | None:
    """The photograph in between that the points of a step went through, if any: the inverse of :func:`packed`."""
    from dicflow.core.correlation.material import Anchor

    if "reference" not in before.attrs:
        return None
    x, y = before.attrs["reference"]["origin"]
    image, usable = before["reference_image"], before["reference_usable"] > 0
    points, warp, passed, slope = (before[f"reference_{name}"] for name in ("xy", "warp", "passed", "slope"))
    return Anchor(image, (x, y), usable, points, warp, passed, slope, before.attrs["reference"]["age"])


def _check_photograph(image: np.ndarray, usable: np.ndarray, subset_size: int) -> None:
    """The first photograph must show a pattern that subsets can be told apart by."""
    from dicflow.core.photographs.pattern import check_pattern, check_subset

    try:
        check_pattern(image, usable, "the first left photograph")
        check_subset(image, usable, subset_size)
    except ValueError as error:
        raise StageError(str(error)) from error
