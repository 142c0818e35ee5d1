"""Every material point found in the right photograph."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field

from dicflow.engine.node import At, Pixels, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.correlation import Correlation, SubsetGrid
from dicflow.kinds.images import Images
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.stereo import Stereo as StereoPoints
from dicflow.stages._lost import lost_status, lost_warning
from dicflow.stages._rig_check import bump_warnings, check_found, check_sizes, misfit
from dicflow.stages._subsets import ShapeFunction, SubsetSearch, photograph_of

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.camera import Rig
    from dicflow.core.correlation.points import FoundPoints
    from dicflow.core.correlation.search import Search
    from dicflow.core.correlation.seed import Pairs

__all__ = ["Stereo", "sentence"]

_SEEDS = 300
"""Points that are searched along their epipolar lines."""
_FOLLOWED_PAIRS = 1000
"""Points whose motion predicts that of the others."""
_SEED_WINDOW = 1.5
"""Side of the windows compared along epipolar lines, in subsets."""

_CHECK_RIGHT = "check that it shows the specimen at the moment of the left one"


class _View(NamedTuple):
    """Photographs and points in the left one, of a step and of the first."""

    images: Images
    images_first: Images
    points: Correlation
    points_first: Correlation


class _Previous(NamedTuple):
    """The previous step."""

    images: Images
    points: Correlation
    stereo: StereoPoints


class Stereo(SubsetSearch):
    """Correlate the subsets of the first left photograph with the right one of each step.

    The template is that of the left camera, so that both show the same material point. A search starts from the place
    in the left photograph: ``start: match`` finds points spread over the region along their epipolar lines, at any
    depth; ``time`` takes the surface of the previous step, and the epipolar lines only if the grey levels disagree with
    it.

    With ``match: first_step`` the cameras are matched at the first step only. From the places found there the right
    photographs are correlated with the first right one, as ``correlate`` does it with the left ones; an error of the
    first match then stays with a point. A point is valid if the grey levels fit and both places belong to one point in
    space. If not given, ``gaussian``, ``min_share``, ``max_iterations``, ``tolerance``, ``smoothing``, ``misfit`` and
    ``reference`` are those of ``correlation``.
    """

    title: ClassVar = "correlate left and right"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {
        "images": Port("images"),
        "images_first": Port("images", at=At.FIRST),
        "images_before": Port("images", at=At.PREVIOUS),
        "rig": Port("rig"),
        "correlation": Port("correlation"),
        "correlation_first": Port("correlation", at=At.FIRST),
        "correlation_before": Port("correlation", at=At.PREVIOUS),
        "stereo_first": Port("stereo", at=At.FIRST, own=True),
        "stereo_before": Port("stereo", at=At.PREVIOUS, own=True),
    }
    gives: ClassVar = "stereo"
    follows: ClassVar = {
        "correlation": (
            "gaussian", "min_share", "max_iterations", "tolerance", "smoothing", "misfit", "reference",
        )
    }  # fmt: skip
    impl_version: ClassVar = 9

    stage: Literal["stereo"] = "stereo"
    match: Literal["every_step", "first_step"] = parameter(
        "every_step", "when points are matched from left to right; with first_step they are followed in time afterwards"
    )
    start: Literal["match", "time"] = parameter(
        "match", "source of the start values of a match: epipolar lines of this step, or the previous step"
    )
    shape_function: ShapeFunction = parameter("quadratic", "how a subset may deform")
    max_epipolar: Annotated[Pixels, Field(gt=0)] = parameter(1.0, "distance from the epipolar line, at most", unit="px")

    def run(
        self,
        images: Product,
        images_first: Product,
        rig: Product,
        correlation: Product,
        correlation_first: Product,
        **before: Product | None,
    ) -> Product:
        """``before`` has the remaining ports, empty at the first step."""
        calibrated = CalibratedRig.read(rig)
        cameras = calibrated.cameras
        view = _View(
            Images.read(images),
            Images.read(images_first),
            Correlation.read(correlation),
            Correlation.read(correlation_first),
        )
        check_sizes(cameras, view.images, view.points["xy"])
        earlier = _previous(**before)
        if earlier is None:
            return self._first_step(calibrated, view)
        stereo_first = before.get("stereo_first")
        if self.match == "first_step" and stereo_first is not None:
            return self._followed(cameras, view, earlier, StereoPoints.read(stereo_first))
        return self._next_step(cameras, view, earlier)

    def _first_step(self, rig: CalibratedRig, view: _View) -> Product:
        """The points matched at the first step; the order of left and right and the pattern are checked."""
        from dicflow.core.correlation.across import contrast, inherited_covariance

        cameras = rig.cameras
        starts = _starts_from_epipolar_lines(cameras, view)
        _check_pattern(view.images.right, starts[..., 0])
        ratio = _noise_ratio(view, starts)
        found, search = self._matched(view, starts, ratio)
        check_found(cameras, view.images, view.points, found, self.max_epipolar)
        product = self._product(cameras, view, found, ratio, bump_warnings(rig, view.points, found))
        if self.match == "every_step":
            return product
        views = (view.images.left, view.points["xy"]), (view.images.right, found.warp[..., 0])
        contrasts = contrast(*views[0]), contrast(*views[1])
        found = found._replace(inherited_covariance=inherited_covariance(found, search, contrasts))
        outline = view.points.outline(view.points_first.polygons, found, view.points_first.parts)
        return StereoPoints.read(product).with_reference(found, outline)

    def _next_step(self, cameras: Rig, view: _View, previous: _Previous) -> Product:
        """The points matched at a later step."""
        starts = _starts_from_previous_step(view, previous) if self.start == "time" else None
        ratio = previous.stereo.noise_ratio
        found, _ = self._matched(view, _starts_from_epipolar_lines(cameras, view) if starts is None else starts, ratio)
        return self._product(cameras, view, found, ratio)

    def _followed(self, cameras: Rig, view: _View, previous: _Previous, first_stereo: StereoPoints) -> Product:
        """The points of the first right photograph, found in that of the step."""
        import numpy as np

        from dicflow.core.correlation.material import follow_step, search_directly
        from dicflow.core.correlation.points import cropped
        from dicflow.core.status import Status

        ratio = previous.stereo.noise_ratio
        search = self._search(view, ratio * view.points.noise_level)
        first = cropped(first_stereo.as_reference(photograph_of(view.images_first, "right")), search.subset.size)
        last = previous.stereo.as_reference(photograph_of(previous.images, "right"))
        reference_step = previous.stereo.reference_step
        image, pairs = photograph_of(view.images, "right"), _predicted_pairs(view, previous)
        direct = search_directly(first, reference_step, last, image, search, pairs)
        found, reference = follow_step(first, reference_step, direct, search, self.reference.updating())
        status = np.where(first_stereo["status"] > Status.FILLED, first_stereo["status"], found.status)
        noise_growth = np.divide(view.points.noise_level, view.points_first.noise_level)
        found = found._replace(status=status, template_covariance=noise_growth**2 * first_stereo["template"])
        product = self._product(cameras, view, found, ratio)
        outline = previous.stereo.outline(view.points_first.polygons, found, view.points_first.parts)
        return StereoPoints.read(product).with_reference(found, outline, reference)

    def _search(self, view: _View, noise: float) -> Search:
        """noise : of the templates' photographs after the low pass [grey levels]"""
        from dicflow.core.status import Status

        found = self.search(view.points.grid.subset_size, noise, self.shape_function)
        jumps = view.points["status"] == Status.DISCONTINUITY
        return found._replace(parts=view.points_first.parts, jumps=jumps)

    def _matched(self, view: _View, starts: np.ndarray, noise_ratio: float) -> tuple[FoundPoints, Search]:
        """The points of the left photograph, found in the right one from starting warps (row, col, 2, 3)."""
        import numpy as np

        from dicflow.core.correlation.across import follow_across
        from dicflow.core.correlation.search import first_photograph, target_spline
        from dicflow.core.photographs.region import interior

        image, right = photograph_of(view.images_first, "left"), photograph_of(view.images, "right")
        search = self._search(view, view.points.noise_level)._replace(target_noise_ratio=noise_ratio)
        region = interior(view.points_first.polygons, image.grey.shape)
        grid = np.where(np.isfinite(view.points["xy"]), view.points_first["xy"], np.nan)
        first, reference_step = first_photograph(image, region, grid, search), view.points.reference_step
        target = target_spline(right, search)
        return follow_across(first, reference_step, view.points["way"], target, starts, search), search

    def _product(
        self, cameras: Rig, view: _View, found: FoundPoints, noise_ratio: float, warnings: Sequence[str] = ()
    ) -> Product:
        import numpy as np

        from dicflow.core.cameras.epipolar import epipolar_distance
        from dicflow.core.correlation.across import overexposed_share, why_lost
        from dicflow.core.status import Status

        left, places = view.points, found.warp[..., 0]
        apart = epipolar_distance(cameras, left["xy"], places)
        grid = np.where(np.isfinite(left["xy"]), view.points_first["xy"], np.nan)
        reasons = why_lost(found, grid, view.images_first.left, view.images.right, view.points_first.parts)
        status = np.where(left["status"] > Status.FILLED, left["status"], reasons).astype(np.uint8)
        status[(status == Status.VALID) & ~(apart <= self.max_epipolar)] = Status.EPIPOLAR
        kept, left_found = status == Status.VALID, bool((left["status"] <= Status.FILLED).any())
        if not kept.any() and left_found:
            status = lost_status(status, view.images.right, (Status.HIDDEN, Status.NO_MATCH))
        share = overexposed_share(view.images.right, places)
        summary = {
            **_summary(left["status"], status, apart[kept], found.iterations[kept]),
            "overexposed_share": share if np.isfinite(share) else None,
        }
        facts: dict[str, Any] = {"interpolation": self.interpolation, "match": self.match, "summary": summary}
        if not kept.any() and left_found:
            warnings = [lost_warning(view.images.right, "right", _CHECK_RIGHT), *warnings]
        if warnings:
            facts["warnings"] = list(warnings)
        subsets = SubsetGrid(left.grid.step_size, left.grid.subset_size, self.shape_function)
        return StereoPoints.write(found, apart, status, subsets, noise_ratio, facts)


def _previous(
    images_before: Product | None = None,
    correlation_before: Product | None = None,
    stereo_before: Product | None = None,
    stereo_first: Product | None = None,
) -> _Previous | None:
    """The previous step; None at the first step."""
    if images_before is None or correlation_before is None or stereo_before is None:
        return None
    return _Previous(Images.read(images_before), Correlation.read(correlation_before), StereoPoints.read(stereo_before))


def _check_pattern(image: np.ndarray, places: np.ndarray) -> None:
    """Raise StageError unless the first right photograph shows a pattern around the points (row, col, 2) [px]."""
    from dicflow.core.correlation.across import grid_mask
    from dicflow.core.photographs.pattern import check_pattern

    seen = grid_mask(image.shape, places)
    try:
        if seen.any():
            check_pattern(image, seen, "the first right photograph")
    except ValueError as error:
        raise StageError(str(error)) from error


def _noise_ratio(view: _View, starts: np.ndarray) -> float:
    """Noise of the right camera over that of the left one; 1 if the noise of both is given."""
    from dicflow.core.correlation.across import noise_ratio

    if view.points.noise_is_given:
        return 1.0
    return noise_ratio(view.images.left, view.images.right, view.points["xy"], starts[..., 0])


def _starts_from_previous_step(view: _View, previous: _Previous) -> np.ndarray | None:
    """Starting warps (row, col, 2, 3) from the previous step; None if the grey levels disagree with it."""
    from dicflow.core.correlation.across import PointsInStep, starts_agree, starts_from_previous_step

    steps = (view.points, previous.points, previous.stereo)
    starts = starts_from_previous_step(*(PointsInStep(step["xy"], step["gradient"]) for step in steps))
    centres = view.points_first["xy"]
    return starts if starts_agree(view.images_first.left, view.images.right, centres, starts) else None


def _predicted_pairs(view: _View, previous: _Previous) -> Pairs:
    """Some points in the right photograph of the previous step, and their places predicted by the left one."""
    import numpy as np

    from dicflow.core.correlation.across import PointsInStep, starts_from_previous_step
    from dicflow.core.correlation.seed import Pairs

    steps = (PointsInStep(step["xy"], step["gradient"]) for step in (view.points, previous.points, previous.stereo))
    places = np.stack([previous.stereo["xy"], starts_from_previous_step(*steps)[..., 0]])
    known = places[:, np.isfinite(places).all(axis=(0, -1))]
    return Pairs(*known[:, :: 1 + known.shape[1] // _FOLLOWED_PAIRS])


def _starts_from_epipolar_lines(cameras: Rig, view: _View) -> np.ndarray:
    """Starting warps (row, col, 2, 3) from points found along their epipolar lines."""
    import numpy as np

    from dicflow.core.correlation.partners import find_partners, right_of_left, starting_warps

    places = view.points["xy"]
    if not np.isfinite(places).all(axis=-1).any():
        return np.full((*places.shape, 3), np.nan)
    stride = int(np.ceil(np.sqrt(np.isfinite(places[..., 0]).sum() / _SEEDS)))
    seeds = places[:: max(1, stride), :: max(1, stride)].reshape(-1, 2)
    window = _SEED_WINDOW * view.points.grid.subset_size
    try:
        partners = find_partners(cameras, view.images.left, view.images.right, seeds, window)
    except ValueError as error:
        reason = misfit(cameras, view.images, places, 0.0) or "use the calibration of these cameras"
        raise StageError(f"the rig cannot be rectified: {error}; {reason}") from error
    return starting_warps(view.points["warp"], *right_of_left(partners, places))


def _summary(left: np.ndarray, status: np.ndarray, apart: np.ndarray, iterations: np.ndarray) -> dict[str, float]:
    """Shares of the points in the left photograph by status."""
    import numpy as np

    from dicflow.core.status import Status

    seen = status[left <= Status.FILLED]
    codes = (Status.VALID, Status.EPIPOLAR, Status.HIDDEN, Status.LOW_CORRELATION)
    shares = {f"{code.name.lower()}_share": float((seen == code).mean()) if seen.size else 0.0 for code in codes}
    if apart.size:
        shares |= {"epipolar_px": float(np.sqrt(np.mean(apart**2))), "iterations": float(iterations.mean())}
    return shares


def sentence(stage: Stereo, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    when = {"every_step": "at every step", "first_step": "at the first step, and followed in time from there"}
    return (
        f"The same subsets were found in the photographs of the right camera {when[stage.match]}, with "
        f"{stage.shape_function} shape functions; points farther than {stage.max_epipolar:g} px from their epipolar "
        "line [hartley2004] were discarded."
    )
