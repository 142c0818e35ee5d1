"""The left photograph of one step without lens distortion, for measurements with one camera."""

from __future__ import annotations

from typing import ClassVar, Literal

from dicflow.engine.node import Node, Port, Scope
from dicflow.engine.product import Product
from dicflow.kinds.images import Images, check_size
from dicflow.kinds.rig import CalibratedRig

__all__ = ["Undistort", "sentence"]


class Undistort(Node):
    """Remove the lens distortion of the left photograph; without a rig the photograph is unchanged."""

    title: ClassVar = "undistort"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {"images": Port("images"), "rig": Port("rig", optional=True)}
    gives: ClassVar = "plane"

    stage: Literal["undistort"] = "undistort"

    def run(self, images: Product, rig: Product | None = None) -> Product:
        import numpy as np

        from dicflow.core.cameras.rectification import rectify, rectify_counts

        photographs = Images.read(images)
        if rig is None:
            return Images.write(photographs.left, kind="plane", counts=photographs.masks)
        camera = CalibratedRig.read(rig).cameras.left
        check_size("left", camera.size, photographs.size)
        way = camera, np.eye(3), camera.matrix, camera.size
        mask = photographs.counts("left")
        counts = {} if mask is None else {"left": rectify_counts(mask, *way)}
        return Images.write(rectify(photographs.left, *way), kind="plane", counts=counts)


def sentence(stage: Undistort, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    return "The lens distortion [brown1971] was removed from the photographs where a calibration was known."
