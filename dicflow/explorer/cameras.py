"""Both cameras in the frame of the measured places."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from dicflow.explorer.content import Keep
from dicflow.explorer.fields import FieldSource
from dicflow.explorer.manifest import CameraFacts
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.total import Total
from dicflow.pipeline.result import Result

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.camera import Camera
    from dicflow.core.cameras.frames import Frame

__all__ = ["camera_facts"]


def camera_facts(result: Result, source: FieldSource, step: str, keep: Keep) -> list[CameraFacts]:
    """The left and the right camera; empty without a rig, or with one camera."""
    stage = next((stage for stage in reversed(result.stages_of("rig")) if result.has(stage)), None)
    if stage is None or source.facts["unit"] != "mm" or result.stages_of("scale"):
        return []
    made = keep(["cameras", result.digest(stage), *source.sources(step)], lambda: _both(result, stage, source, step))
    found: list[CameraFacts] = json.loads(made)
    return found


def _both(result: Result, stage: str, source: FieldSource, step: str) -> bytes:
    import numpy as np

    rig = CalibratedRig.read(result.product(stage)).cameras
    frame = _frame(result, source, step)
    left = _facts("left camera", rig.left, (np.eye(3), np.zeros(3)), frame)
    right = _facts("right camera", rig.right, (rig.rotation, rig.translation), frame)
    return json.dumps([left, right]).encode()


def _frame(result: Result, source: FieldSource, step: str) -> Frame:
    """The frame of the places at a step, in the left camera's."""
    from dicflow.core.cameras.frames import LEFT_CAMERA

    product = result.product(source.facts["stage"], step)
    total = Total.read(product) if product.kind == "total" else None
    return total.frames[0] if total is not None and total.has_uncertainty else LEFT_CAMERA


def _facts(name: str, camera: Camera, pose: tuple[np.ndarray, np.ndarray], frame: Frame) -> CameraFacts:
    """pose : turn and shift; a place X of the left camera's frame is turn @ X + shift in this one's"""
    import numpy as np

    turn, shift = pose
    width, height = camera.size
    pixels = np.array([(0.0, 0.0), (width - 1.0, 0.0), (width - 1.0, height - 1.0), (0.0, height - 1.0)])
    ideal = (pixels - camera.matrix[:2, 2]) / np.diag(camera.matrix)[:2]
    rays = np.concatenate([ideal, np.ones((4, 1))], axis=1) @ turn
    centre = frame.rotation @ (-turn.T @ shift - frame.origin)
    return CameraFacts(name=name, centre=centre.tolist(), corners=(rays @ frame.rotation.T).tolist())
