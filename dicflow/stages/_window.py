"""A window of the cameras' sensors that was set after they were calibrated."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.images import Images
from dicflow.kinds.rig import CalibratedRig

__all__ = ["OFFSET", "Offset", "with_windows"]

OFFSET = (
    "first pixel [x, y] of the photographs in those of the calibration, {left: [x, y], right: [x, y]}, where the "
    "window of a camera's sensor was set smaller after the calibration"
)

Place = tuple[float, float]


class Offset(BaseModel):
    """Where the windows of both cameras begin in the photographs of their calibration [px]."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    left: Place = (0.0, 0.0)
    right: Place = (0.0, 0.0)


def with_windows(rig: Product, offset: Offset | None, images: Product | None) -> Product:
    """The rig for windows of the sensors that are as large as the photographs; the same rig without an offset.

    Raises StageError without photographs.
    """
    from dicflow.core.cameras.camera import windowed

    if offset is None:
        return rig
    if images is None:
        raise StageError("offset needs the photographs of the specimen; name their stage as 'images'")
    found = CalibratedRig.read(rig)
    cameras, photographs = found.cameras, Images.read(images)
    left, right = (image.shape[::-1] for image in (photographs.left, photographs.right))
    cameras = cameras._replace(
        left=windowed(cameras.left, offset.left, left), right=windowed(cameras.right, offset.right, right)
    )
    return found.with_windows(cameras, offset.model_dump())
