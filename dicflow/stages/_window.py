"""A window of the cameras' sensors that was set after they were calibrated."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import BaseModel, ConfigDict

from dicflow.kinds.images import Images

if TYPE_CHECKING:
    from dicflow.core.cameras.camera import Rig

__all__ = ["OFFSET", "Offset", "windowed_rig"]

OFFSET = (
    "first pixel [x, y] of the photographs in those of the calibration, {left: [x, y], right: [x, y]}, where the window "
    "of a camera's sensor was set smaller after the calibration"
)

Place = tuple[float, float]


class Offset(BaseModel):
    """Where the windows of both cameras begin in the photographs of their calibration [px]."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    left: Place = (0.0, 0.0)
    right: Place = (0.0, 0.0)


def windowed_rig(rig: Rig, offset: Offset | None, images: Images | None) -> Rig:
    """The rig for windows of the sensors as large as the photographs; the same rig without an offset."""
    from dicflow.core.cameras.camera import windowed

    if offset is None or images is None:
        return rig
    sizes = {side: (image.shape[1], image.shape[0]) for side, image in images.sides}
    return rig._replace(
        left=windowed(rig.left, offset.left, sizes["left"]),
        right=windowed(rig.right, offset.right, sizes.get("right", sizes["left"])),
    )
