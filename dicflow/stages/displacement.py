"""Displacement from one step to the next."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from dicflow.engine.node import At, Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.cloud import Cloud
from dicflow.kinds.increment import Increment
from dicflow.kinds.track import Track

if TYPE_CHECKING:
    from dicflow.core.surfaces.displacement import Cloud as CloudField
    from dicflow.core.surfaces.displacement import Increment as IncrementField

__all__ = ["Displacement"]


class Displacement(Node):
    """How far the specimen moved since the previous step.

    ``material`` follows the points of the track: the vector between their places in the two clouds. ``thesis`` is the
    definition of the thesis on every third pixel of the deformed region, in which both components hold the whole change
    of depth. Without clouds the measurement has one camera, and displacement is in pixels.
    """

    title: ClassVar = "displacement of each step"
    scope: ClassVar = Scope.PAIR
    takes: ClassVar = {
        "track": Port("track"),
        "track_before": Port("track", at=At.PREVIOUS),
        "cloud": Port("cloud", optional=True),
        "cloud_before": Port("cloud", at=At.PREVIOUS, optional=True),
    }
    gives: ClassVar = "increment"

    stage: Literal["displacement"] = "displacement"
    definition: Literal["material", "thesis"] = parameter(
        "material", "vectors of material points, or the thesis's dx and dy on the deformed pixel grid"
    )

    def run(
        self,
        track: Product,
        track_before: Product,
        cloud: Product | None = None,
        cloud_before: Product | None = None,
    ) -> Product:
        if (cloud is None) != (cloud_before is None):
            raise StageError("one of the two clouds is missing; name 'cloud' and 'cloud_before', or neither")
        clouds = (
            None if cloud_before is None else Cloud.read(cloud_before).field,
            None if cloud is None else Cloud.read(cloud).field,
        )
        tracks = Track.read(track_before), Track.read(track)
        field, step_size = (_material if self.definition == "material" else _thesis)(*tracks, *clouds)
        unit = "px" if cloud is None else "mm"
        return Increment.write(field, self.definition, step_size, unit, _summary(field))


def _material(
    before: Track, after: Track, cloud_before: CloudField | None, cloud: CloudField | None
) -> tuple[IncrementField, float]:
    import numpy as np

    from dicflow.core.surfaces.displacement import material_increment

    status = np.maximum(before["status"], after["status"])
    return material_increment(before["points"], after["points"], status, cloud_before, cloud), after.step_size


def _thesis(
    before: Track, after: Track, cloud_before: CloudField | None, cloud: CloudField | None
) -> tuple[IncrementField, float]:
    from dicflow.core.surfaces.displacement import WINDOW_PX, thesis_increment

    field = thesis_increment(after["transforms"], before.polygons, after.polygons, cloud_before, cloud)
    return field, float(WINDOW_PX)


def _summary(increment: IncrementField) -> dict[str, float]:
    import numpy as np

    return {"measured_share": float(np.isfinite(increment.displacement).all(axis=2).mean())}
