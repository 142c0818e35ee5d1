"""The point cloud of one step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from dicflow.engine.node import At, Millimetres, Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.cloud import Cloud
from dicflow.kinds.disparity import DisparityMap
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.track import Track

if TYPE_CHECKING:
    import numpy as np

__all__ = ["Reconstruct", "sentence"]

Gate = Annotated[Millimetres, Field(gt=0)]


class Reconstruct(Node):
    """Turn disparities into points in the left camera's frame.

    Points outside the tracked region, and points of the background seen over its edge, have no value. Nor has any point
    of a later step than the first whose photographs are exchanged.
    """

    title: ClassVar = "reconstruct points"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {
        "disparity": Port("disparity"),
        "rig": Port("rig"),
        "track": Port("track", optional=True),
        "cloud_first": Port("cloud", at=At.FIRST, own=True),
    }
    gives: ClassVar = "cloud"

    stage: Literal["reconstruct"] = "reconstruct"
    depth_gate: Literal["auto", "off"] | Gate = parameter(
        "auto",
        "largest distance of a point from the specimen's surface; auto takes it from the scatter in a tracked region",
        unit="mm",
    )

    def run(
        self, disparity: Product, rig: Product, track: Product | None = None, cloud_first: Product | None = None
    ) -> Product:
        import numpy as np

        from dicflow.core.cameras.rectification import rectification, triangulate_disparity
        from dicflow.core.status import Status

        disparities = DisparityMap.read(disparity)
        x0, y0 = disparities.origin
        values, status = disparities["disparity"], disparities["status"].copy()
        if track is not None:
            status[~_inside(Track.read(track), (x0, y0), values.shape)] = Status.OUTSIDE
        view = rectification(CalibratedRig.read(rig).cameras)
        places = np.stack(
            np.broadcast_arrays(np.arange(values.shape[1]) + x0, np.arange(values.shape[0])[:, None] + y0), -1
        )
        xyz = triangulate_disparity(places, np.where(status == Status.VALID, values, np.nan), view)
        problem = _not_in_front(xyz[..., 2][status == Status.VALID])
        if problem and cloud_first is None:
            raise StageError(problem)
        if problem:
            status[status == Status.VALID] = Status.NO_MATCH
        status[(status == Status.VALID) & np.isnan(xyz[..., 2])] = Status.NO_MATCH
        background = self._background(np.where(status == Status.VALID, xyz[..., 2], np.nan), track is not None)
        status[background] = Status.BACKGROUND
        xyz[status != Status.VALID] = np.nan
        return Cloud.write(xyz, status, (x0, y0), _summary(status), warnings=[problem] if problem else [])

    def _background(self, depth: np.ndarray, in_region: bool) -> np.ndarray:
        """Points beyond the depth gate (rows, cols)."""
        import numpy as np

        from dicflow.core.surfaces.depth import is_background

        if self.depth_gate == "off" or (self.depth_gate == "auto" and not in_region):
            return np.zeros(depth.shape, dtype=bool)
        return is_background(depth, None if self.depth_gate == "auto" else self.depth_gate)


def _not_in_front(depth: np.ndarray) -> str:
    """What is wrong if most points lie behind the cameras, as exchanged photographs turn the sign of disparities."""
    in_front = (depth > 0.0).mean() if depth.size else 1.0
    if in_front >= 0.5:
        return ""
    return (
        f"only {in_front:.0%} of the points lie in front of the cameras, so left and right photographs are "
        "swapped or come from another rig; exchange left and right"
    )


def _inside(track: Track, origin: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
    """Pixels of the map that lie in the region at this step."""
    from dicflow.core.photographs.region import carry, rasterise

    return rasterise(carry(track.polygons, lambda ring: ring - origin), shape)


def _summary(status: np.ndarray) -> dict[str, float]:
    """Shares of the region's points that have a value, and that belong to the background."""
    from dicflow.core.status import Status

    region = max(1, int((status != Status.OUTSIDE).sum()))
    return {
        "valid_share": float((status == Status.VALID).sum() / region),
        "background_share": float((status == Status.BACKGROUND).sum() / region),
    }


def sentence(stage: Reconstruct, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    return "Points in space were computed from the disparities."
