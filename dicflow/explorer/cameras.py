"""Both cameras in the frame of the measured places."""

from __future__ import annotations

import numpy as np

from dicflow.core.cameras.camera import Camera
from dicflow.core.cameras.frames import LEFT_CAMERA, Frame
from dicflow.errors import DicflowError
from dicflow.explorer.fields import FieldSource
from dicflow.explorer.manifest import CameraFacts
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.total import Total
from dicflow.pipeline.result import Result

__all__ = ["camera_facts"]


def camera_facts(result: Result, source: FieldSource, step: str) -> list[CameraFacts]:
    """The left and the right camera; empty without a rig, or with one camera."""
    if source.unit != "mm":
        return []
    for stage in result.stages_of("rig"):
        try:
            rig = CalibratedRig.read(result.product(stage)).cameras
            frame = _frame(result, source, step)
        except DicflowError:
            continue
        poses = (
            ("left camera", rig.left, np.eye(3), np.zeros(3)),
            ("right camera", rig.right, rig.rotation, rig.translation),
        )
        return [_facts(name, camera, turn, shift, frame) for name, camera, turn, shift in poses]
    return []


def _frame(result: Result, source: FieldSource, step: str) -> Frame:
    """The frame of the places at a step, in the left camera's."""
    product = result.product(source.stage, step)
    total = Total.read(product) if product.kind == "total" else None
    return total.frames[0] if total is not None and total.has_uncertainty else LEFT_CAMERA


def _facts(name: str, camera: Camera, turn: np.ndarray, shift: np.ndarray, frame: Frame) -> CameraFacts:
    """turn, shift : X in the camera = turn @ X in the left camera + shift"""
    width, height = camera.size
    pixels = np.array([(0.0, 0.0), (width - 1.0, 0.0), (width - 1.0, height - 1.0), (0.0, height - 1.0)])
    ideal = (pixels - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2]
    rays = np.concatenate([ideal, np.ones((4, 1))], axis=1) @ turn
    centre = frame.rotation @ (-turn.T @ shift - frame.origin)
    return CameraFacts(name=name, centre=centre.tolist(), corners=(rays @ frame.rotation.T).tolist())
