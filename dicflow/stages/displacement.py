"""Displacement from one step to the next."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from dicflow.engine.node import At, Node, Port, Scope, parameter
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError

if TYPE_CHECKING:
    from dicflow.core.surfaces.displacement import Cloud, Increment

__all__ = ["Displacement"]


class Displacement(Node):
    """How far the specimen moved since the step before.

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
        clouds = (_cloud(cloud_before), _cloud(cloud))
        if self.definition == "material":
            increment, step_size = _material(track_before, track, *clouds), float(track.attrs["step_size"])
        else:
            increment, step_size = _thesis(track_before, track, *clouds)
        unit = "px" if cloud is None else "mm"
        attrs = {"definition": self.definition, "step_size": step_size, "unit": unit}
        return Product("increment", _variables(increment, unit), {**attrs, "summary": _summary(increment)})


def _cloud(product: Product | None) -> Cloud | None:
    from dicflow.core.surfaces.displacement import Cloud

    if product is None:
        return None
    x, y = product.attrs["origin"]
    return Cloud(product["xyz"], product["status"], (x, y))


def _material(before: Product, after: Product, cloud_before: Cloud | None, cloud: Cloud | None) -> Increment:
    import numpy as np

    from dicflow.core.surfaces.displacement import material_increment

    status = np.maximum(before["status"], after["status"])
    return material_increment(before["points"], after["points"], status, cloud_before, cloud)


def _thesis(
    before: Product, after: Product, cloud_before: Cloud | None, cloud: Cloud | None
) -> tuple[Increment, float]:
    from dicflow.core.surfaces.displacement import WINDOW_PX, thesis_increment
    from dicflow.kinds.region import polygons_from_json

    region_before, region = (polygons_from_json(product.attrs["polygons"]) for product in (before, after))
    return thesis_increment(after["transforms"], region_before, region, cloud_before, cloud), float(WINDOW_PX)


def _variables(increment: Increment, unit: str) -> dict[str, Variable]:
    vector = ("row", "col", "component")
    return {
        "xy": Variable(("row", "col", "image_component"), increment.xy, "px", "place in the image"),
        "xyz_reference": Variable(vector, increment.xyz_reference, unit, "place at the step before"),
        "xyz": Variable(vector, increment.xyz, unit, "place"),
        "displacement": Variable(vector, increment.displacement, unit, "displacement since the step before"),
        "status": Variable(("row", "col"), increment.status, "1", "why a point has a value, or has none"),
    }


def _summary(increment: Increment) -> dict[str, float]:
    import numpy as np

    return {"measured_share": float(np.isfinite(increment.displacement).all(axis=2).mean())}
