"""The frame in which results are given."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from dicflow.engine.product import Product
from dicflow.kinds.kind import Kind

if TYPE_CHECKING:
    from dicflow.core.cameras.frames import Frame

__all__ = ["ResultFrame", "frame_from_json", "frame_to_json"]


class ResultFrame(Kind):
    """Axes of the results in the left camera's frame."""

    KINDS: ClassVar = ("frame",)

    @classmethod
    def write(cls, frame: Frame, method: str, summary: Mapping[str, float]) -> Product:
        """A product of axes.

        method : what determined them
        """
        return Product("frame", attrs={"method": method, **frame_to_json(frame), "summary": dict(summary)})

    @property
    def axes(self) -> Frame:
        """Rotation and origin [mm]."""
        return frame_from_json(self.product.attrs)


def frame_to_json(frame: Frame) -> dict[str, list[Any]]:
    """A frame in JSON values."""
    return {"rotation": frame.rotation.tolist(), "origin_mm": frame.origin.tolist()}


def frame_from_json(values: Mapping[str, Any]) -> Frame:
    """The inverse of :func:`frame_to_json`."""
    import numpy as np

    from dicflow.core.cameras.frames import Frame

    return Frame(np.array(values["rotation"]), np.array(values["origin_mm"]))
