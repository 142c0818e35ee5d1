"""The left photograph of one step without lens distortion, for measurements with one camera."""

from __future__ import annotations

from typing import ClassVar, Literal

from dicflow.engine.node import Node, Port, Scope
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError

__all__ = ["Undistort"]


class Undistort(Node):
    """Take out the lens distortion of the left photograph; without a rig it stays as it is."""

    title: ClassVar = "undistort"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {"images": Port("images"), "rig": Port("rig", optional=True)}
    gives: ClassVar = "plane"

    stage: Literal["undistort"] = "undistort"

    def run(self, images: Product, rig: Product | None = None) -> Product:
        import numpy as np

        from dicflow.core.cameras.rectification import rectify
        from dicflow.kinds.rig import rig_from_json

        image = images["left"]
        if rig is not None:
            camera = rig_from_json(rig.attrs["rig"]).left
            if image.shape[::-1] != camera.size:
                raise StageError(
                    f"the left camera was calibrated on photographs of {camera.size[0]} × {camera.size[1]} px, but "
                    f"this one has {image.shape[1]} × {image.shape[0]}; photograph the board at the same settings"
                )
            image = rectify(image, camera, np.eye(3), camera.matrix, camera.size)
        return Product("plane", {"left": Variable(("row", "col"), image, "grey level", "undistorted photograph")})
