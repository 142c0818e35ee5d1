"""Every material point found in the right photograph."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, NamedTuple

from pydantic import Field

from dicflow.engine.node import At, Node, Pixels, Port, Scope, parameter
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.camera import Rig
    from dicflow.core.correlate import Subset, Template
    from dicflow.core.follow import Field as Followed
    from dicflow.core.interpolate import Spline

__all__ = ["Stereo", "check_size"]

SEEDS = 300  # points that are looked for along their epipolar lines
SEED_WINDOW = 1.5  # side of what is compared there, in subsets
ENOUGH = 0.5  # share of the points that starts from the step before must lead to, else the lines are searched

_GRID = ("row", "col")


class View(NamedTuple):
    """What is compared at one step: template of the first left photograph, right photograph, and centres of subsets.

    grid : (row, col, 2) — in the first left photograph, of what the left one of this step shows [px]
    """

    template: Template
    right: Spline
    grid: np.ndarray
    subset: Subset


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
        "images_before": Port("images", at=At.FIRST),
        "rig": Port("rig"),
        "correlation": Port("correlation"),
        "correlation_before": Port("correlation", at=At.FIRST),
        "correlation_last": Port("correlation", at=At.PREVIOUS, optional=True),
        "stereo_last": Port("stereo", at=At.PREVIOUS, own=True, optional=True),
    }
    gives: ClassVar = "stereo"

    stage: Literal["stereo"] = "stereo"
    start: Literal["match", "time"] = parameter(
        "match", "where starting values come from: epipolar lines of this step, or the step before"
    )
    shape_function: Literal["affine", "quadratic"] = parameter("quadratic", "how a subset may deform")
    interpolation: Literal["bicubic", "biquintic"] = parameter("biquintic", "of grey levels between pixels")
    max_znssd: float = parameter(0.6, "zero-mean normalised sum of squared differences, at most", gt=0, le=2)
    max_epipolar: Annotated[Pixels, Field(gt=0)] = parameter(1.0, "distance from the epipolar line, at most", unit="px")

    def run(
        self,
        images: Product,
        images_before: Product,
        rig: Product,
        correlation: Product,
        correlation_before: Product,
        correlation_last: Product | None = None,
        stereo_last: Product | None = None,
    ) -> Product:
        """``before`` is the first step, ``last`` the one before this one."""

        from dicflow.io.rig import rig_from_dict

        cameras = rig_from_dict(rig.attrs["rig"])
        _check_photographs(images, cameras)
        view = self._view(images, images_before, correlation, correlation_before)
        found = None
        if self.start == "time" and correlation_last is not None and stereo_last is not None:
            found = self._followed(view, _from_last(correlation, correlation_last, stereo_last))
        if found is None or _share(found, view.grid) < ENOUGH:
            found = self._followed(view, _from_partners(cameras, images, correlation))
        if stereo_last is None:
            _check_order(cameras, images, correlation, found)
        gain = _contrast(view.right.image, found.warp[..., 0]) / _contrast(view.template.grey, view.grid)
        return self._product(cameras, correlation, found, gain)

    def _view(self, images: Product, images_before: Product, correlation: Product, correlation_before: Product) -> View:
        """What is compared at this step."""
        import numpy as np

        from dicflow.core.correlate import Subset, template
        from dicflow.core.interpolate import spline
        from dicflow.core.region import polygons_from_attrs, rasterise

        degree = 5 if self.interpolation == "biquintic" else 3
        usable = rasterise(polygons_from_attrs(correlation_before.attrs["polygons"]), images_before["left"].shape)
        seen = np.isfinite(correlation["xy"]).all(axis=-1)
        return View(
            template(spline(images_before["left"], degree), usable),
            spline(images["right"], degree),
            np.where(seen[..., None], correlation_before["xy"], np.nan),
            Subset(correlation.attrs["subset_size"], self.shape_function),
        )

    def _followed(self, view: View, starts: np.ndarray) -> Followed:
        from dicflow.core.follow import correlate_field

        return correlate_field(view.template, view.right, view.grid, starts, view.subset, max_znssd=self.max_znssd)

    def _product(self, cameras: Rig, correlation: Product, found: Followed, gain: float) -> Product:
        import numpy as np

        from dicflow.core.epipolar import epipolar_distance
        from dicflow.core.status import Status

        places = found.warp[..., 0]
        apart = epipolar_distance(cameras, correlation["xy"], places)
        status = _status(correlation["status"], found.status)
        status[(status == Status.VALID) & ~(apart <= self.max_epipolar)] = Status.EPIPOLAR
        kept = status == Status.VALID
        own = 0.5 * (correlation.attrs["noise_grey"] / gain) ** 2 * found.covariance

        def where_kept(values: np.ndarray) -> np.ndarray:
            return np.where(kept.reshape(kept.shape + (1,) * (values.ndim - 2)), values, np.nan)

        pixel, terms = ("image_component",), ("image_component", "term")
        variables = {
            "xy": Variable((*_GRID, *pixel), where_kept(places), "px", "place in the right photograph"),
            "gradient": Variable(
                (*_GRID, "out", "in"), where_kept(found.warp[..., 1:3]), "1", "gradient of the motion into it"
            ),
            "znssd": Variable(_GRID, found.znssd.astype(np.float32), "1", "misfit of the grey levels (ZNSSD)"),
            "iterations": Variable(_GRID, found.iterations, "1", "iterations"),
            "epipolar": Variable(_GRID, apart.astype(np.float32), "px", "distance from the epipolar line"),
            "covariance": Variable(
                (*_GRID, "pair"), where_kept(own).astype(np.float32), "px²", "covariance xx, xy, yy of the place"
            ),
            "warp": Variable((*_GRID, *terms), where_kept(found.warp), "px", "warp from the first left photograph"),
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


def _from_last(correlation: Product, correlation_last: Product, stereo_last: Product) -> np.ndarray:
    """Starting warps (row, col, 2, 3) if the right photograph still saw the surface as it did at the step before."""
    import numpy as np

    from dicflow.core.partners import started

    before, across = correlation_last["gradient"], np.full(correlation["gradient"].shape, np.nan)
    known = np.isfinite(before).all(axis=(-2, -1)) & np.isfinite(stereo_last["gradient"]).all(axis=(-2, -1))
    across[known] = stereo_last["gradient"][known] @ np.linalg.inv(before[known])
    moved = across @ (correlation["xy"] - correlation_last["xy"])[..., None]
    return started(correlation["warp"], stereo_last["xy"] + moved[..., 0], across)


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
    pairs, few = (places, found.warp[..., 0]), _share(found, places) < ENOUGH
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


def _share(found: Followed, places: np.ndarray) -> float:
    """Share of the places (row, col, 2) [px] in the left photograph that were found in the right one."""
    import numpy as np

    from dicflow.core.status import Status

    seen = np.isfinite(places).all(axis=-1)
    return float((found.status[seen] == Status.VALID).mean()) if seen.any() else 0.0


def _status(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Status of points (row, col): the left photograph's reason first, then the right one's."""
    import numpy as np

    from dicflow.core.status import Status

    hidden = np.isin(right, (Status.OUTSIDE, Status.UNTRACKED, Status.NOT_CONVERGED))
    return np.where(left > Status.FILLED, left, np.where(hidden, Status.HIDDEN, right)).astype(np.uint8)


def _contrast(image: np.ndarray, places: np.ndarray) -> float:
    """Standard deviation of the grey levels at places (..., 2); 1 without any."""
    import numpy as np

    x, y = np.rint(places[np.isfinite(places).all(axis=-1)]).astype(int).T
    return float(image[y, x].std()) or 1.0 if len(x) > 1 else 1.0


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
