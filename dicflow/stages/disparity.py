"""The disparity map of one step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import AfterValidator

from dicflow.engine.node import At, Node, Odd, Pixels, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.disparity import DisparityMap
from dicflow.kinds.images import Images
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.track import Track
from dicflow.stages._lost import lost_warning

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.photographs.polygon import Polygon

__all__ = ["Disparity", "sentence"]

WEAK_GRADIENT = 3.0
"""Mean intensity gradient below which the pattern, not the range, is the likely cause [grey levels per px]."""
MIN_VALID_SHARE = 0.005
"""Of the region's pixels."""
MIN_MATCHED_SHARE = 0.1
"""Of the pixels with texture; a few per cent match by chance."""


def _ordered(value: tuple[int, int]) -> tuple[int, int]:
    if value[0] >= value[1]:
        raise ValueError(f"a range is [least, largest] with least < largest, but {value[0]} ≥ {value[1]}")
    return value


Range = Annotated[tuple[int, int], AfterValidator(_ordered)]


class _Place(NamedTuple):
    """Where disparities are searched for.

    box : (x0, y0, x1, y1) of the part that is matched, ends excluded [px]
    counts : (rows, cols) — pixels of the region; photographed : pixels that show the photograph
    """

    box: tuple[int, int, int, int]
    counts: np.ndarray
    photographed: np.ndarray

    @property
    def part(self) -> tuple[slice, slice]:
        """Rows and columns of the box."""
        x0, y0, x1, y1 = self.box
        return slice(y0, y1), slice(x0, x1)


class Disparity(Node):
    """Match both rectified photographs along their rows by semi-global matching, to a few hundredths of a pixel.

    Only the part of the photograph that holds the tracked region is matched, with a margin, where ``track`` is given. A
    later step than the first in which almost no pixel is matched has no disparities, and a warning.
    """

    title: ClassVar = "disparity"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {
        "pair": Port("rectified"),
        "rig": Port("rig", optional=True),
        "track": Port("track", optional=True),
        "disparity_first": Port("disparity", at=At.FIRST, own=True),
    }
    gives: ClassVar = "disparity"

    stage: Literal["disparity"] = "disparity"
    range: Literal["auto"] | Range = parameter(
        "auto", "least and largest x_left − x_right, widened to a multiple of 16; auto finds it by features", unit="px"
    )
    window: Odd = parameter(5, "side of the window of the semi-global matching", unit="px", ge=1, le=31)
    uniqueness: int = parameter(5, "margin by which the best match must beat the second", unit="%", ge=0, le=100)
    left_right: Pixels = parameter(1.0, "largest difference of matching from left and from right", unit="px", ge=0)
    speckle: int = parameter(200, "islands of similar disparity of fewer pixels are removed", unit="px²", ge=0)
    texture: float = parameter(1.5, "least root mean square slope of the grey level along a row", unit="1/px", ge=0)
    refine: Odd = parameter(21, "side of the window of the sub-pixel refinement", unit="px", ge=5, le=101)
    correlation: float = parameter(0.6, "least correlation of the windows that the refinement compares", ge=-1, le=1)
    margin: Pixels = parameter(24.0, "width of the band around the region that is matched too", unit="px", ge=0)

    def run(
        self,
        pair: Product,
        rig: Product | None = None,
        track: Product | None = None,
        disparity_first: Product | None = None,
    ) -> Product:
        from dicflow.core.matching.disparity import box_around
        from dicflow.core.photographs.region import bounding_box, rasterise

        images, followed = Images.read(pair), None if track is None else Track.read(track)
        shape = images.left.shape
        polygons = _polygons(shape, followed)
        box, photographed = box_around(bounding_box(polygons), self.margin, shape), _photographed(shape, rig)
        place = _Place(box or (0, 0, *shape[::-1]), rasterise(polygons, shape) & photographed, photographed)
        first = None if disparity_first is None else DisparityMap.read(disparity_first)
        if first is not None and followed is not None and followed.is_lost:
            return _lost(images, place, first.limits)
        try:
            if box is None:
                raise StageError("the region lies outside the rectified photograph at this step; check its track")
            return self._matched(images, place)
        except StageError as error:
            if first is None:
                raise
            return _lost(images, place, first.limits, str(error))

    def _matched(self, images: Images, place: _Place) -> Product:
        """The disparities. Raises StageError where there are almost none."""
        import numpy as np

        from dicflow.core.matching.disparity import match_rows
        from dicflow.core.status import Status

        box, counts, photographed = place
        left, right = images.left, images.right
        limits = self._limits(left, right, counts)
        matched = match_rows(left, right, box, limits, self._matching())
        status = np.where(photographed[place.part], matched.status, np.uint8(Status.OUTSIDE))
        summary = _summary(status[counts[place.part]], limits)
        textured = 1.0 - summary["low_texture_share"]
        if summary["valid_share"] < max(MIN_VALID_SHARE, MIN_MATCHED_SHARE * textured):
            raise StageError(_no_disparities(left, counts, limits))
        values = np.where(status == Status.VALID, matched.disparity, np.float32(np.nan))
        return DisparityMap.write(values, status, matched.origin, limits, summary)

    def _limits(self, left: np.ndarray, right: np.ndarray, counts: np.ndarray) -> tuple[int, int]:
        """Range [low, high) of disparities, a multiple of 16 long."""
        from dicflow.core.matching.disparity import disparity_range

        if self.range != "auto":
            low, high = self.range
            return low, low + 16 * -(-(high + 1 - low) // 16)
        limits = disparity_range(left, right, counts)
        if limits is None:
            raise StageError(_no_disparities(left, counts, None))
        return limits

    def _matching(self) -> Any:
        from dicflow.core.matching.disparity import MatchingParameters

        return MatchingParameters(
            self.window, self.uniqueness, self.left_right, self.speckle, self.texture, self.refine, self.correlation
        )


def _lost(images: Images, place: _Place, limits: tuple[int, int], problem: str = "") -> Product:
    """The product of a step without disparities. problem : why there are none; empty if the track says it"""
    import numpy as np

    from dicflow.core.photographs.texture import textured_box
    from dicflow.core.status import Status

    dark = [side for side, image in images.sides if textured_box(image) is None]
    code = Status.LOW_TEXTURE if dark else Status.NO_MATCH
    status = np.where(place.counts[place.part], np.uint8(code), np.uint8(Status.OUTSIDE))
    values = np.full(status.shape, np.nan, dtype=np.float32)
    x0, y0, _, _ = place.box
    warnings = [f"no disparities at this step: {problem}"] if problem else []
    warnings = [lost_warning(images[side], side) for side in dark] or warnings
    summary = _summary(status[place.counts[place.part]], limits)
    return DisparityMap.write(values, status, (x0, y0), limits, summary, warnings)


def _polygons(shape: tuple[int, ...], track: Track | None) -> list[Polygon]:
    """The region at this step; the whole image without a track."""
    from dicflow.core.photographs.region import rectangle

    rows, cols = shape
    return [rectangle(0, 0, cols - 1, rows - 1)] if track is None else track.polygons


def _photographed(shape: tuple[int, int], rig: Product | None) -> np.ndarray:
    """Mask of the rectified left image: pixels that show the photograph; all of them without a rig."""
    import numpy as np

    from dicflow.core.cameras.rectification import photograph_outline, rectification
    from dicflow.core.photographs.polygon import Polygon
    from dicflow.core.photographs.region import rasterise

    if rig is None:
        return np.ones(shape, dtype=bool)
    cameras = CalibratedRig.read(rig).cameras
    view = rectification(cameras)
    return rasterise([Polygon(photograph_outline(cameras.left, view.rotation_left, view.matrix_left))], shape)


def _summary(status: np.ndarray, limits: tuple[int, int]) -> dict[str, float]:
    """Shares of the region's pixels by status, and the range."""
    from dicflow.core.status import Status

    codes = (Status.VALID, Status.LOW_TEXTURE, Status.NO_MATCH, Status.LEFT_RIGHT, Status.SPECKLE)
    shares = {f"{code.name.lower()}_share": float((status == code).mean()) if status.size else 0.0 for code in codes}
    return shares | {"range_low_px": limits[0], "range_high_px": limits[1]}


def _no_disparities(left: np.ndarray, counts: np.ndarray, limits: tuple[int, int] | None) -> str:
    """The message for a region without disparities, which names the cause: the pattern or the range."""
    from dicflow.core.photographs.texture import mean_intensity_gradient

    gradient = mean_intensity_gradient(left, counts) if counts.any() else 0.0
    if gradient < WEAK_GRADIENT:
        return (
            f"the region has too little texture to match: its mean intensity gradient is {gradient:.1f} grey levels "
            "per px, and a speckle pattern has 5 or more; light the specimen, renew its speckles, or correct the region"
        )
    if limits is None:
        return (
            "no range of disparities was found, since too few features match along the rows; check that this rig took "
            "the photographs, or give the range as [least, largest]"
        )
    return (
        f"almost no pixel matches at disparities from {limits[0]} to {limits[1]} px; check that this rig took the "
        "photographs, and give another range, or auto"
    )


def sentence(stage: Disparity, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    return (
        f"Left and right photographs were matched by semi-global matching [hirschmuller2008] with windows "
        f"of {stage.window} px, and disparities refined by the grey levels in windows of {stage.refine} px [lucas1981]."
    )
