"""The photographs of one step with their rows aligned."""

from __future__ import annotations

from typing import ClassVar, Literal

from dicflow.engine.node import Node, Port, Scope
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.images import Images
from dicflow.kinds.rig import CalibratedRig

__all__ = ["Rectify", "sentence"]


class Rectify(Node):
    """Align the rows of both photographs; both stay whole, at their own scale."""

    title: ClassVar = "rectify"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {"images": Port("images"), "rig": Port("rig")}
    gives: ClassVar = "rectified"

    stage: Literal["rectify"] = "rectify"

    def run(self, images: Product, rig: Product) -> Product:
        from dicflow.core.cameras.rectification import rectification, rectify, rectify_counts

        photographs, cameras = Images.read(images), CalibratedRig.read(rig).cameras
        photographs.check_sizes(cameras)
        try:
            view = rectification(cameras)
        except ValueError as error:
            raise StageError(f"the rig cannot be rectified: {error}; use the calibration of these cameras") from error
        ways = {
            "left": (cameras.left, view.rotation_left, view.matrix_left, view.size),
            "right": (cameras.right, view.rotation_right, view.matrix_right, view.size),
        }
        left, right = rectify(photographs.left, *ways["left"]), rectify(photographs.right, *ways["right"])
        counts = {side: rectify_counts(mask, *ways[side]) for side, mask in photographs.masks.items()}
        return Images.write(left, right, "rectified", counts)


def sentence(stage: Rectify, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    return "The photographs were rectified, so that both cameras show a point in the same row [fusiello2000]."
