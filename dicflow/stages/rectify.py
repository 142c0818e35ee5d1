"""The photographs of one step with their rows aligned."""

from __future__ import annotations

from typing import ClassVar, Literal

from dicflow.engine.node import Node, Port, Scope
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError

__all__ = ["Rectify"]


class Rectify(Node):
    """Align the rows of both photographs; all of both is seen, at their own scale."""

    title: ClassVar = "rectify"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {"images": Port("images"), "rig": Port("rig")}
    gives: ClassVar = "rectified"

    stage: Literal["rectify"] = "rectify"

    def run(self, images: Product, rig: Product) -> Product:
        from dicflow.core.cameras.rectification import rectification, rectify
        from dicflow.kinds.rig import rig_from_json

        if "right" not in images:
            raise StageError("rectifying takes photographs of two cameras, but there are no right ones; name them")
        cameras = rig_from_json(rig.attrs["rig"])
        for side, camera in (("left", cameras.left), ("right", cameras.right)):
            size = images[side].shape[::-1]
            if size != camera.size:
                raise StageError(
                    f"the {side} camera was calibrated on photographs of {camera.size[0]} × {camera.size[1]} px, but "
                    f"this one has {size[0]} × {size[1]}; photograph the board with the settings used for the specimen"
                )
        try:
            view = rectification(cameras)
        except ValueError as error:
            raise StageError(f"the rig cannot be rectified: {error}; calibrate again") from error
        left = rectify(images["left"], cameras.left, view.rotation_left, view.matrix_left, view.size)
        right = rectify(images["right"], cameras.right, view.rotation_right, view.matrix_right, view.size)
        return Product(
            "rectified",
            {
                "left": Variable(("row", "col"), left, "grey level", "rectified left photograph"),
                "right": Variable(("row", "col"), right, "grey level", "rectified right photograph"),
            },
        )
