"""Every material point found in the right photograph."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, NamedTuple

from pydantic import Field

from dicflow.engine.node import At, Node, Pixels, Port, Scope, parameter
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.camera import Rig
    from dicflow.core.correlation.material import Anchor, Followed, Search
    from dicflow.core.correlation.seed import Pairs

__all__ = ["Stereo", "check_size"]

SEEDS = 300  # points that are looked for along their epipolar lines
PAIRS = 1000  # points that tell how the others have moved
SEED_WINDOW = 1.5  # side of what is compared there, in subsets
ENOUGH = 0.5  # share of the points that, when found, tells the order of left and right; else features do
DEGREES = {"bicubic": 3, "biquintic": 5}

_GRID = ("row", "col")


class View(NamedTuple):
    """Photographs and places in the left one, of a step and of the first."""

    images: Product
    images_first: Product
    correlation: Product
    correlation_first: Product


class Before(NamedTuple):
    """The step before."""

    images: Product
    correlation: Product
    stereo: Product


class Stereo(Node):
    """Correlate the subsets of the first left photograph with the right one of each step.

    The template is that of the left camera, so that both show the same material point. Where a subset is looked for
    comes from its place in the left photograph: ``start: match`` finds points spread over the region anew along their
    epipolar lines, at any depth; ``time`` takes how the right photograph saw the surface at the step before, and the
    lines only where the grey levels do not bear that out.

    With ``match: first_step`` the cameras are matched at the first step only. From the places found there the right
    photographs are correlated with the first right one, as ``correlate`` does it with the left ones; what the first
    match got wrong then stays with a point. Either way, a point counts where the grey levels fit and the two places are
    of one point in space.
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
    impl_version: ClassVar = 4

    stage: Literal["stereo"] = "stereo"
    match: Literal["every_step", "first_step"] = parameter(
        "every_step", "when points are matched from left to right; after the first step alone they are followed in time"
    )
    start: Literal["match", "time"] = parameter(
        "match", "where starting values of a match come from: epipolar lines of this step, or the step before"
    )
    shape_function: Literal["affine", "quadratic"] = parameter("quadratic", "how a subset may deform")
    interpolation: Literal["bicubic", "biquintic"] = parameter("biquintic", "spline between the pixels")
    max_znssd: float = parameter(
        0.3, "what fits worse than this is lost (the zero-mean cross-correlation is 1 − ZNSSD/2)", gt=0, le=4
    )
    max_epipolar: Annotated[Pixels, Field(gt=0)] = parameter(1.0, "distance from the epipolar line, at most", unit="px")
    threads: int = parameter(1, "threads that share the points of a step", affects="speed", ge=1)

    def run(
        self,
        images: Product,
        images_first: Product,
        rig: Product,
        correlation: Product,
        correlation_first: Product,
        images_before: Product | None = None,
        correlation_before: Product | None = None,
        stereo_first: Product | None = None,
        stereo_before: Product | None = None,
    ) -> Product:
        from dicflow.core.correlation.across import overexposed, passed_on
        from dicflow.kinds.rig import rig_from_json

        cameras = rig_from_json(rig.attrs["rig"])
        _check_photographs(images, cameras)
        view = View(images, images_first, correlation, correlation_first)
        if self.match == "first_step" and images_before and correlation_before and stereo_first and stereo_before:
            before = Before(images_before, correlation_before, stereo_before)
            return self._followed(cameras, view, before, stereo_first)
        starts = None
        if self.start == "time" and correlation_before is not None and stereo_before is not None:
            starts = _from_before(view, correlation_before, stereo_before)
        starts = _from_partners(cameras, view) if starts is None else starts
        if stereo_before is None:
            _check_pattern(images["right"], starts[..., 0])
        ratio = _noise_ratio(view, starts) if stereo_before is None else stereo_before.attrs["noise_ratio"]
        found, search = self._matched(view, starts, ratio)
        if stereo_before is None:
            _check_order(cameras, view, found)
        product = self._product(cameras, correlation, found, ratio, overexposed(images["right"], starts[..., 0]))
        if self.match == "every_step":
            return product
        return _to_follow(product, found._replace(passed=passed_on(found, search)), view, correlation)

    def _followed(self, cameras: Rig, view: View, before: Before, stereo_first: Product) -> Product:
        """What the first right photograph shows in the one of the step."""
        import numpy as np

        from dicflow.core.correlation.across import overexposed
        from dicflow.core.correlation.material import cropped, follow_step
        from dicflow.core.status import Status
        from dicflow.stages.correlate import Reference, anchor_of, carried_reference, updating

        image, ratio = view.images["right"], before.stereo.attrs["noise_ratio"]
        search = self._search(view.correlation)
        search = search._replace(noise=ratio * search.noise)
        first = cropped(anchor_of(stereo_first, view.images_first["right"]), search.subset.size)
        last, known = anchor_of(before.stereo, before.images["right"]), carried_reference(before.stereo)
        rule = updating(Reference(**view.correlation.attrs["updating"]))
        found, reference = follow_step(first, known, last, image, search, rule, _moved_along(view, before))
        status = np.where(stereo_first["status"] > Status.FILLED, stereo_first["status"], found.status)
        levels = (part.attrs["noise_level"] for part in (view.correlation, view.correlation_first))
        found = found._replace(status=status, template=np.divide(*levels) ** 2 * stereo_first["template"])
        product = self._product(cameras, view.correlation, found, ratio, overexposed(image, found.warp[..., 0]))
        return _to_follow(product, found, view, before.stereo, reference)

    def _matched(self, view: View, starts: np.ndarray, noise_ratio: float) -> tuple[Followed, Search]:
        """What the left photograph of the step shows in the right one, from starting warps (row, col, 2, 3)."""
        import numpy as np

        from dicflow.core.correlation.across import contrast, follow_across
        from dicflow.core.correlation.material import first_anchor, prepared
        from dicflow.core.photographs.region import interior
        from dicflow.kinds.region import polygons_from_json
        from dicflow.stages.correlate import carried_reference

        image, right = view.images_first["left"], view.images["right"]
        contrasts = contrast(image, view.correlation_first["xy"]), contrast(right, starts[..., 0])
        search = self._search(view.correlation)._replace(strength=noise_ratio * contrasts[0] / contrasts[1])
        usable = interior(polygons_from_json(view.correlation_first.attrs["polygons"]), image.shape)
        grid = np.where(np.isfinite(view.correlation["xy"]), view.correlation_first["xy"], np.nan)
        first, reference = first_anchor(image, usable, grid, search), carried_reference(view.correlation)
        target = prepared(right, search)
        return follow_across(first, reference, view.correlation["way"], target, starts, search), search

    def _search(self, correlation: Product) -> Search:
        from dicflow.core.correlation.material import Search
        from dicflow.core.correlation.subsets import Subset

        facts = correlation.attrs
        convergence = facts["max_iterations"], facts["tolerance"]
        subset = Subset(facts["subset_size"], self.shape_function, facts["gaussian"], facts["min_share"], *convergence)
        degree, noise = DEGREES[self.interpolation], facts["noise_level"]
        return Search(
            subset,
            degree,
            facts["smoothing"],
            self.max_znssd,
            noise,
            threads=self.threads,
            counts_misfit=facts["misfit"],
        )

    def _product(
        self, cameras: Rig, correlation: Product, found: Followed, noise_ratio: float, overexposed: float
    ) -> Product:
        """overexposed : share of the points in the right photograph; NaN where none is seen"""
        import numpy as np

        from dicflow.core.cameras.epipolar import epipolar_distance
        from dicflow.core.status import Status

        places = found.warp[..., 0]
        apart = epipolar_distance(cameras, correlation["xy"], places)
        status = _status(correlation["status"], found.status)
        status[(status == Status.VALID) & ~(apart <= self.max_epipolar)] = Status.EPIPOLAR
        kept = status == Status.VALID

        def measured(values: np.ndarray, units: str, long_name: str, *beyond: str) -> Variable:
            part = np.where(kept.reshape(kept.shape + (1,) * (values.ndim - 2)), values, np.nan)
            return Variable((*_GRID, *beyond), part, units, long_name)

        variables = {
            "xy": measured(places, "px", "place in the right photograph", "component"),
            "gradient": measured(found.warp[..., 1:3], "1", "gradient of the motion into it", "out", "in"),
            "warp": measured(found.warp, "1", "warp of the subset", "component", "term"),
            "covariance": measured(
                found.covariance, "px²", "covariance of the place by this photograph's noise", "pair"
            ),
            "template": measured(found.template, "px²", "covariance by the first photograph's noise", "pair"),
            "znssd": Variable(_GRID, found.znssd, "1", "ZNSSD"),
            "iterations": Variable(_GRID, found.iterations, "1", "iterations"),
            "way": Variable(
                _GRID, found.way, "1", "0 no value, 1 directly from the first photograph, 2 through another"
            ),
            "epipolar": Variable(_GRID, apart, "px", "distance from the epipolar line"),
            "status": Variable(_GRID, status, "1", "why a point has a place, or has none"),
        }
        attrs = {
            **{name: correlation.attrs[name] for name in ("step_size", "subset_size")},
            "shape_function": self.shape_function,
            "interpolation": self.interpolation,
            "match": self.match,
            "noise_ratio": noise_ratio,
            "summary": {
                **_summary(correlation["status"], status, apart[kept], found.iterations[kept]),
                "overexposed_share": overexposed if np.isfinite(overexposed) else None,
            },
        }
        return Product("stereo", variables, attrs)


def _to_follow(
    product: Product, found: Followed, view: View, before: Product, reference: Anchor | None = None
) -> Product:
    """A step with what its points are followed from at the next ones.

    before : whose outline holds where too little was found
    """
    from dicflow.kinds.region import polygons_from_json, polygons_to_json
    from dicflow.stages.correlate import carried_outline, packed

    facts = view.correlation_first.attrs
    outline = polygons_from_json(facts["polygons"])
    polygons = carried_outline(outline, found, view.correlation_first["xy"], before)
    variables = {
        "passed": Variable((*_GRID, "pair"), found.passed, "px²", "share of photographs before in the covariance"),
        "slope": Variable((*_GRID, "out", "in"), found.slope, "1", "gradient from the photograph that found it"),
    }
    attrs = {"polygons": polygons_to_json(polygons)}
    if reference is None:
        return Product(product.kind, {**product.variables, **variables}, {**product.attrs, **attrs})
    carried, fact = packed(reference, facts["subset_size"])
    return Product(
        product.kind, {**product.variables, **variables, **carried}, {**product.attrs, **attrs, "reference": fact}
    )


def check_size(side: str, camera_size: tuple[int, int], size: tuple[int, int]) -> None:
    """Raise StageError where a camera was calibrated on photographs of another size (width, height)."""
    if tuple(size) != tuple(camera_size):
        raise StageError(
            f"the {side} camera was calibrated on photographs of {camera_size[0]} × {camera_size[1]} px, but this one "
            f"has {size[0]} × {size[1]} px; use the calibration of this camera with the settings of the specimen's "
            "photographs"
        )


def _check_photographs(images: Product, cameras: Rig) -> None:
    if "right" not in images:
        raise StageError("stereo takes photographs of two cameras, but there are no right ones; name them")
    for side, camera in (("left", cameras.left), ("right", cameras.right)):
        rows, cols = images[side].shape
        check_size(side, camera.size, (cols, rows))


def _check_pattern(image: np.ndarray, places: np.ndarray) -> None:
    """The first right photograph must show a pattern where the points are, about (row, col, 2), as far as is known."""
    from dicflow.core.correlation.across import enclosed
    from dicflow.core.photographs.pattern import check_pattern

    seen = enclosed(image.shape, places)
    try:
        if seen.any():
            check_pattern(image, seen, "the first right photograph")
    except ValueError as error:
        raise StageError(str(error)) from error


def _noise_ratio(view: View, starts: np.ndarray) -> float:
    """Noise of the right camera over that of the left one; 1 where the noise of both is given."""
    from dicflow.core.correlation.across import noise_ratio

    if view.correlation.attrs.get("noise_source") == "given":
        return 1.0
    return noise_ratio(view.images["left"], view.images["right"], view.correlation["xy"], starts[..., 0])


def _from_before(view: View, correlation_before: Product, stereo_before: Product) -> np.ndarray | None:
    """Starting warps (row, col, 2, 3) if the right photograph sees the surface as before; None where it does not."""
    from dicflow.core.correlation.across import Step, as_before, borne_out

    steps = (view.correlation, correlation_before, stereo_before)
    starts = as_before(*(Step(step["xy"], step["gradient"]) for step in steps))
    centres = view.correlation_first["xy"]
    return starts if borne_out(view.images_first["left"], view.images["right"], centres, starts) else None


def _moved_along(view: View, before: Before) -> Pairs:
    """Some points in the right photograph of the step before, and where the motion in the left one puts them."""
    import numpy as np

    from dicflow.core.correlation.across import Step, as_before
    from dicflow.core.correlation.seed import Pairs

    steps = (Step(step["xy"], step["gradient"]) for step in (view.correlation, before.correlation, before.stereo))
    places = np.stack([before.stereo["xy"], as_before(*steps)[..., 0]])
    known = places[:, np.isfinite(places).all(axis=(0, -1))]
    return Pairs(*known[:, :: 1 + known.shape[1] // PAIRS])


def _from_partners(cameras: Rig, view: View) -> np.ndarray:
    """Starting warps (row, col, 2, 3) from points found along their epipolar lines."""
    import numpy as np

    from dicflow.core.correlation.partners import find_partners, right_of_left, started

    places = view.correlation["xy"]
    stride = int(np.ceil(np.sqrt(np.isfinite(places[..., 0]).sum() / SEEDS)))
    seeds = places[:: max(1, stride), :: max(1, stride)].reshape(-1, 2)
    window = SEED_WINDOW * view.correlation.attrs["subset_size"]
    try:
        partners = find_partners(cameras, view.images["left"], view.images["right"], seeds, window)
    except ValueError as error:
        raise StageError(f"the rig cannot be rectified: {error}; calibrate again") from error
    return started(view.correlation["warp"], *right_of_left(partners, places))


def _check_order(cameras: Rig, view: View, found: Followed) -> None:
    """Raise StageError where left and right are exchanged, or nothing is seen by both cameras."""
    import numpy as np

    from dicflow.core.cameras.geometry_check import check_order
    from dicflow.core.correlation.seed import feature_pairs

    places = view.correlation["xy"]
    pairs = (places, found.warp[..., 0])
    if found.valid.sum() < ENOUGH * np.isfinite(places).all(axis=-1).sum():
        pairs = feature_pairs(view.images["left"], view.images["right"], places)
    order = check_order(cameras, *pairs)
    if order.swapped:
        raise StageError(order.text)
    if not np.isfinite(found.znssd).any():
        raise StageError(
            "no point of the region is found in the right photograph; check that both photographs show the specimen, "
            "well exposed, and are of one moment"
        )


def _status(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Status of points (row, col): the left photograph's reason first, then the right one's."""
    import numpy as np

    from dicflow.core.status import Status

    hidden = np.isin(right, (Status.OUTSIDE, Status.UNTRACKED, Status.NOT_CONVERGED))
    return np.where(left > Status.FILLED, left, np.where(hidden, Status.HIDDEN, right)).astype(np.uint8)


def _summary(left: np.ndarray, status: np.ndarray, apart: np.ndarray, iterations: np.ndarray) -> dict[str, float]:
    """Shares of the points that the left photograph shows, by what became of them."""
    import numpy as np

    from dicflow.core.status import Status

    seen = status[left <= Status.FILLED]
    codes = (Status.VALID, Status.EPIPOLAR, Status.HIDDEN, Status.LOW_CORRELATION)
    shares = {f"{code.name.lower()}_share": float((seen == code).mean()) if seen.size else 0.0 for code in codes}
    if apart.size:
        shares |= {"epipolar_px": float(np.sqrt(np.mean(apart**2))), "iterations": float(iterations.mean())}
    return shares
