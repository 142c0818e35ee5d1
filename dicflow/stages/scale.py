"""Millimetres per pixel of one camera, from a known length or a board in the specimen's plane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from dicflow.engine.node import At, Millimetres, Node, Pixels, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.boards import BoardMarks
from dicflow.kinds.images import Images
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.scale import Scale as ScaleProduct
from dicflow.stages._target import target_of

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.calibration.plane_scale import PlaneScale
    from dicflow.core.cameras.camera import Camera

__all__ = ["Scale", "sentence"]

Coordinate = Annotated[float, Field(ge=-0.5)]
Place = tuple[Coordinate, Coordinate]

_MOST_VARIATION = 0.005


class Scale(Node):
    """Give a measurement with one camera in millimetres.

    Either from a known ``length`` between two places of a photograph, or from a board that lies in the plane of the
    specimen, found by a stage ``corners`` in photographs by the same camera at the same place. The scale's uncertainty
    is common to all points and steps: the displacement and the lengths of probes have it as the calibration's share.
    Strain does not depend on the scale.

    One camera sees a motion towards it as a growth in all directions: a strain of −dz / stand-off for a motion dz away
    from it. ``stand_off`` says how much that is; with a board and a calibrated camera it follows from these.
    """

    title: ClassVar = "scale of one camera"
    scope: ClassVar = Scope.TEST
    takes: ClassVar = {
        "images": Port("images", "plane", at=At.FIRST),
        "corners": Port("corners", at=At.ALL, optional=True),
        "rig": Port("rig", optional=True),
    }
    gives: ClassVar = "scale"

    stage: Literal["scale"] = "scale"
    length: Millimetres | None = parameter(None, "known length between the two ends", unit="mm", gt=0)
    u_length: Millimetres = parameter(0.0, "its standard uncertainty", unit="mm", ge=0)
    ends: tuple[Place, Place] | None = parameter(None, "[[x, y], [x, y]], the ends of the known length", unit="px")
    u_end: Pixels = parameter(0.5, "standard uncertainty of the place of each end", unit="px", ge=0)
    square: Millimetres | None = parameter(
        None, "side of one square of the board; of circles the distance of neighbouring rows", unit="mm", gt=0
    )
    u_square: Millimetres = parameter(0.0, "its standard uncertainty", unit="mm", ge=0)
    stand_off: Millimetres | None = parameter(
        None, "distance of the camera's lens from the specimen; absent: by the rig, if one is known", unit="mm", gt=0
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.length is None) != (self.ends is None):
            raise ValueError("a known length needs both length and ends")
        if (self.length is None) == (self.square is None):
            raise ValueError("give either length and ends, or the square of a board in the plane of the specimen")
        if self.ends is not None and self.ends[0] == self.ends[1]:
            raise ValueError("ends are one place; give the two ends of the length")
        return self

    def joins(self, port: str) -> bool:
        return port != "corners" or self.square is not None

    def run(self, images: Product, corners: Sequence[Product] | None = None, rig: Product | None = None) -> Product:
        photographs = Images.read(images)
        camera = None if rig is None else CalibratedRig.read(rig).cameras.left
        if self.length is not None:
            found = self._of_length(photographs)
        else:
            found = self._of_boards(corners, camera if photographs.product.kind == "plane" else None)
        stand_off = self.stand_off
        if stand_off is None and camera is not None:
            stand_off = found.mm_per_px * float(camera.matrix[0, 0] + camera.matrix[1, 1]) / 2.0
        return ScaleProduct.write(found.mm_per_px, found.u, stand_off, _warnings(found, stand_off))

    def _of_length(self, photographs: Images) -> PlaneScale:
        from dicflow.core.calibration.plane_scale import scale_of_length

        assert self.length is not None
        assert self.ends is not None
        width, height = photographs.size
        for x, y in self.ends:
            if x > width - 0.5 or y > height - 0.5:
                raise StageError(f"an end of the length, [{x:g}, {y:g}], lies outside the {width} × {height} px")
        return scale_of_length(self.ends, self.length, self.u_length, self.u_end)

    def _of_boards(self, corners: Sequence[Product] | None, camera: Camera | None) -> PlaneScale:
        """The scale of all boards that were found. camera : whose distortion the photographs lack; None for none"""
        import numpy as np

        from dicflow.core.calibration.plane_scale import common_scale, scale_of_board
        from dicflow.core.calibration.targets import determines_pose

        assert self.square is not None
        if corners is None:
            raise StageError("a scale by a board needs the corners in photographs of it; add a stage 'corners'")
        found = []
        for board in map(BoardMarks.read, corners):
            marks, points = board["left"], target_of(board.board, self.square).points
            if len(marks) and determines_pose(points, np.isfinite(marks[:, 0])):
                straight = marks if camera is None else _without_distortion(marks, camera)
                found.append(scale_of_board(straight, points[:, :2], self.u_square / self.square))
        if not found:
            raise StageError(
                "the board was found in no photograph; photograph it in the plane of the specimen, or give a length"
            )
        return common_scale(found)


def _without_distortion(marks: np.ndarray, camera: Camera) -> np.ndarray:
    """Places (n, 2) in the photograph without the distortion of the lens [px]."""
    from dicflow.core.cameras.camera import undistort

    return undistort(camera, marks) @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]


def _warnings(found: PlaneScale, stand_off: float | None) -> list[str]:
    """What a motion out of the plane does, and a camera that looks at it from the side."""
    if stand_off is None:
        texts = [
            "one camera: a motion towards it reads as a strain, and the stand-off is not given, so that it cannot be "
            "stated how large a one; give stand_off in the stage of the scale"
        ]
    else:
        texts = [
            f"one camera, {stand_off:.4g} mm from the specimen: each mm of motion away from it reads as a strain of "
            f"−{100.0 / stand_off:.2g} % in all directions"
        ]
    if found.variation > _MOST_VARIATION:
        texts.append(
            f"the scale changes by {100.0 * found.variation:.2g} % over the board: the camera looks at the plane from "
            "the side; turn it square to the specimen, or measure with two cameras"
        )
    return texts


def sentence(stage: Scale, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    source = "a known length" if stage.length is not None else "a board in the plane of the specimen"
    if product is None:
        return f"The scale was taken from {source}."
    scale = ScaleProduct.read(product)
    stand_off = "" if scale.stand_off_mm is None else f"; the stand-off was {scale.stand_off_mm:.4g} mm"
    return (
        f"The scale, {scale.mm_per_px:.5g} mm/px with a relative standard uncertainty of "
        f"{100 * scale.relative_u:.2g} %, was taken from {source}{stand_off}."
    )
