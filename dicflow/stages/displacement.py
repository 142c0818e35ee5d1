"""Displacement from one step to the next."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from dicflow.engine.node import At, Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.cloud import Cloud
from dicflow.kinds.increment import Increment, Since, lost_increment, since_of
from dicflow.kinds.parts import parts_in, with_parts
from dicflow.kinds.track import Track

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.surfaces.displacement import Cloud as CloudField
    from dicflow.core.surfaces.displacement import Increment as IncrementField

__all__ = ["Displacement", "sentence"]


class Displacement(Node):
    """How far the specimen moved since the previous step.

    ``material`` follows the points of the track: the vector between their places in the two clouds. ``thesis`` is the
    definition of the thesis on every third pixel of the deformed region, in which both components hold the whole change
    of depth. Without clouds the measurement has one camera, and displacement is in pixels. After a step without any
    displacement, the motion is that since the last step that has one.
    """

    title: ClassVar = "displacement of each step"
    scope: ClassVar = Scope.PAIR
    takes: ClassVar = {
        "track": Port("track"),
        "track_before": Port("track", at=At.PREVIOUS),
        "cloud": Port("cloud", optional=True),
        "cloud_before": Port("cloud", at=At.PREVIOUS, optional=True),
        "increment_before": Port("increment", at=At.PREVIOUS, optional=True, own=True),
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
        increment_before: Product | None = None,
    ) -> Product:
        if (cloud is None) != (cloud_before is None):
            raise StageError("one of the two clouds is missing; name 'cloud' and 'cloud_before', or neither")
        followed = Track.read(track)
        since = _since(Track.read(track_before), cloud_before, increment_before)
        here = None if cloud is None else Cloud.read(cloud).field
        if self.definition == "material":
            field, step_size = _material(since, followed, here), followed.step_size
        else:
            field, step_size = _thesis(since, followed, here)
        unit = "px" if cloud is None else "mm"
        written = Increment.write(field, self.definition, step_size, unit, _summary(field))
        increment = with_parts(written, parts_in(track))
        return increment if Increment(increment).has_values else lost_increment(increment, _passed(since, followed))


def _since(track: Track, cloud: Product | None, increment: Product | None) -> Since:
    """The state from which the displacement is measured: the previous step, or the last one that has displacements."""
    if increment is not None and (last := since_of(increment)) is not None:
        return last
    return Since(track.last, None if cloud is None else Cloud.read(cloud).field, None)


def _passed(since: Since, track: Track) -> Since:
    """The state with the transforms from it to a step without displacements."""
    return since if track.is_lost else since._replace(transforms=_transforms(since, track))


def _transforms(since: Since, track: Track) -> np.ndarray:
    """Transforms (subset_row, subset_col, 3, 3) of the subsets from the state to this step."""
    if since.transforms is None:
        return track["transforms"]
    transforms = track["transforms"] @ since.transforms
    normalised: np.ndarray = transforms / transforms[..., 2:, 2:]
    return normalised


def _material(since: Since, track: Track, cloud: CloudField | None) -> IncrementField:
    import numpy as np

    from dicflow.core.surfaces.displacement import material_increment

    status = np.maximum(since.points.status, track["status"])
    return material_increment(since.points.points, track["points"], status, since.cloud, cloud)


def _thesis(since: Since, track: Track, cloud: CloudField | None) -> tuple[IncrementField, float]:
    from dicflow.core.surfaces.displacement import WINDOW_PX, thesis_increment

    if parts_in(track.product) is not None:
        raise StageError(
            "the thesis's definition joins the parts of a region into one grid; set definition: material, or choose a "
            "region of one polygon without cuts"
        )
    outlines = since.points.polygons, track.polygons
    return thesis_increment(_transforms(since, track), *outlines, since.cloud, cloud), float(WINDOW_PX)


def _summary(increment: IncrementField) -> dict[str, float]:
    import numpy as np

    return {"measured_share": float(np.isfinite(increment.displacement).all(axis=2).mean())}


def sentence(stage: Displacement, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    return "Displacements were computed from each step to the next."
