"""Every material point found in the right photograph."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from dicflow.engine.node import At, Node, Pixels, Port, Scope, parameter
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np

    from dicflow.core.across import Shares, Step
    from dicflow.core.camera import Rig
    from dicflow.core.material import Followed, Search

__all__ = ["Stereo", "check_size"]

SEEDS = 300  # points that are looked for along their epipolar lines
SEED_WINDOW = 1.5  # side of what is compared there, in subsets
ENOUGH = 0.5  # share of the points that starts from the step before must lead to, else the lines are searched
DEGREES = {"bicubic": 3, "biquintic": 5}

_GRID = ("row", "col")


class Stereo(Node):
    """Correlate the subsets of the first left photograph with the right one of each step.

    The template is that of the left camera, so that both show the same material point. Where a subset is looked for
    comes from its place in the left photograph: ``match`` finds points spread over the region anew along their epipolar
    lines, at any depth; ``time`` takes how the right photograph saw the surface at the step before, and only where that
    leads nowhere the lines. A point counts where the grey levels fit and the two places are of one point in space.
    """

    title: ClassVar = "correlate left and right"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {
        "images": Port("images"),
        "images_first": Port("images", at=At.FIRST),
        "rig": Port("rig"),
        "correlation": Port("correlation"),
        "correlation_first": Port("correlation", at=At.FIRST),
        "correlation_before": Port("correlation", at=At.PREVIOUS),
        "stereo_before": Port("stereo", at=At.PREVIOUS, own=True),
    }
    gives: ClassVar = "stereo"

    stage: Literal["stereo"] = "stereo"
    start: Literal["match", "time"] = parameter(
        "match", "where starting values come from: epipolar lines of this step, or the step before"
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
        correlation_before: Product | None = None,
        stereo_before: Product | None = None,
    ) -> Product:
        from dicflow.core.across import as_before, contrast, noise_shares
        from dicflow.io.rig import rig_from_dict

        cameras = rig_from_dict(rig.attrs["rig"])
        _check_photographs(images, cameras)
        search = self._search(correlation)
        follow = _follower(images, images_first, correlation, correlation_first, search)
        found = None
        if self.start == "time" and correlation_before is not None and stereo_before is not None:
            found = follow(as_before(*map(_step, (correlation, correlation_before, stereo_before))))
        if found is None or _share(found, correlation) < ENOUGH:
            found = follow(_from_partners(cameras, images, correlation))
        if stereo_before is None:
            _check_order(cameras, images, correlation, found)
        sides = (images["right"], found.warp[..., 0]), (images_first["left"], correlation_first["xy"])
        right, left = (contrast(image, places) for image, places in sides)
        return self._product(cameras, correlation, found, noise_shares(found, right / left))

    def _search(self, correlation: Product) -> Search:
        from dicflow.core.correlate import Subset
        from dicflow.core.material import Search

        facts = correlation.attrs
        subset = Subset(facts["subset_size"], self.shape_function, facts["gaussian"], facts["min_share"])
        degree, noise = DEGREES[self.interpolation], facts["noise_grey"]
        return Search(subset, degree, facts["smoothing"], self.max_znssd, noise, self.threads)

    def _product(self, cameras: Rig, correlation: Product, found: Followed, shares: Shares) -> Product:
        import numpy as np

        from dicflow.core.epipolar import epipolar_distance
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
            "covariance": measured(shares.own, "px²", "covariance of the place by this photograph's noise", "pair"),
            "template": measured(shares.template, "px²", "covariance by the first photograph's noise", "pair"),
            "znssd": Variable(_GRID, found.znssd, "1", "ZNSSD"),
            "iterations": Variable(_GRID, found.iterations, "1", "iterations"),
            "epipolar": Variable(_GRID, apart, "px", "distance from the epipolar line"),
            "status": Variable(_GRID, status, "1", "why a point has a place, or has none"),
        }
        attrs = {
            **{name: correlation.attrs[name] for name in ("step_size", "subset_size")},
            "shape_function": self.shape_function,
            "interpolation": self.interpolation,
            "summary": _summary(correlation["status"], status, apart[kept], found.iterations[kept]),
        }
        return Product("stereo", variables, attrs)


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


def _follower(
    images: Product, images_first: Product, correlation: Product, correlation_first: Product, search: Search
) -> Callable[[np.ndarray], Followed]:
    """What finds the points that the left photograph of a step shows in the right one, from starting warps."""
    import numpy as np

    from dicflow.core.across import follow_across
    from dicflow.core.material import first_anchor, prepared
    from dicflow.core.region import interior, polygons_from_attrs
    from dicflow.stages.correlate import carried_reference

    usable = interior(polygons_from_attrs(correlation_first.attrs["polygons"]), images_first["left"].shape)
    grid = np.where(np.isfinite(correlation["xy"]), correlation_first["xy"], np.nan)
    first, reference = first_anchor(images_first["left"], usable, grid, search), carried_reference(correlation)
    target = prepared(images["right"], search)
    return lambda starts: follow_across(first, reference, correlation["way"], target, starts, search)


def _step(product: Product) -> Step:
    from dicflow.core.across import Step

    return Step(product["xy"], product["gradient"])


def _from_partners(cameras: Rig, images: Product, correlation: Product) -> np.ndarray:
    """Starting warps (row, col, 2, 3) from points found along their epipolar lines."""
    import numpy as np

    from dicflow.core.partners import find_partners, right_of_left, started

    places = correlation["xy"]
    stride = int(np.ceil(np.sqrt(np.isfinite(places[..., 0]).sum() / SEEDS)))
    seeds = places[:: max(1, stride), :: max(1, stride)].reshape(-1, 2)
    window = SEED_WINDOW * correlation.attrs["subset_size"]
    try:
        partners = find_partners(cameras, images["left"], images["right"], seeds, window)
    except ValueError as error:
        raise StageError(f"the rig cannot be rectified: {error}; calibrate again") from error
    return started(correlation["warp"], *right_of_left(partners, places))


def _check_order(cameras: Rig, images: Product, correlation: Product, found: Followed) -> None:
    """Raise StageError where left and right are exchanged, or nothing is seen by both cameras."""
    import numpy as np

    from dicflow.core.geometry_check import check_order
    from dicflow.core.seed import feature_pairs

    places = correlation["xy"]
    pairs, few = (places, found.warp[..., 0]), _share(found, correlation) < ENOUGH
    if few:
        pairs = feature_pairs(images["left"], images["right"], places)
    order = check_order(cameras, *pairs)
    if order.swapped:
        raise StageError(order.text)
    if not np.isfinite(found.znssd).any():
        raise StageError(
            "no point of the region is found in the right photograph; check that both photographs show the specimen "
            "and are of one moment"
        )


def _share(found: Followed, correlation: Product) -> float:
    """Share of what the left photograph shows that was found in the right one."""
    from dicflow.core.status import Status

    seen = correlation["status"] <= Status.FILLED
    return float((found.status[seen] == Status.VALID).mean()) if seen.any() else 0.0


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
