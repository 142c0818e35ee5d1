"""Places of the points of a test in the left photograph, also of points followed in a rectified one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

from dicflow.errors import StoreError
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.total import Total
from dicflow.kinds.track import Track
from dicflow.pipeline.result import Result

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.camera import Rig

    Mapping = Callable[[np.ndarray], np.ndarray]

__all__ = ["Places", "to_left_photograph"]

ImageKind = Literal["images", "rectified", "plane"]


def to_left_photograph(kind: ImageKind, rig: Rig | None) -> Mapping | None:
    """The mapping of pixels (..., 2) of an image to those of the left photograph [px]; None if they are the same.

    kind : the photograph itself, its image with aligned rows, or without distortion
    rig : None if the cameras are unknown; then the image is the photograph
    """
    import numpy as np

    from dicflow.core.cameras.rectification import rectification, rectified_to_raw

    if kind == "images" or rig is None:
        return None
    turn, matrix = np.eye(3), rig.left.matrix
    if kind == "rectified":
        view = rectification(rig)
        turn, matrix = view.rotation_left, view.matrix_left
    return lambda pixels: rectified_to_raw(pixels, rig.left, turn, matrix)


class Places:
    """Places in the left photographs of one variant of a result [px].

    ``images`` is the stage of the images in which points are followed, ``photographs`` the one of the cameras' own.
    """

    def __init__(self, result: Result, variant: int = 0) -> None:
        self._result, self._variant = result, variant
        self.images = result.source(result.stages_of("region")[0], "images", variant)
        taken = result.kind(self.images) != "rectified"
        self.photographs = self.images if taken else result.source(self.images, "images", variant)

    @property
    def grid(self) -> str | None:
        """The stage whose first step has the places of the grid; None if no points were followed."""
        return next((stage for kind in ("correlation", "track") for stage in self._result.stages_of(kind)), None)

    def at_step(self, total: Total) -> np.ndarray:
        """Places (row, col, 2) of a total's points at its step, in the photographs of :attr:`photographs`."""
        return self._drawn(total["xy"])

    def at_first_step(self) -> np.ndarray:
        """Places (row, col, 2) of the whole grid at the first step, in the photographs of :attr:`photographs`."""
        return self._drawn(self._grid())

    def has_first(self, total: Total) -> bool:
        """Whether a total's points are the same material at every step, so that the first photograph shows each."""
        return "xy_reference" in total or (total.definition == "material" and bool(self._result.stages_of("track")))

    def of_first(self, total: Total) -> np.ndarray:
        """Places (row, col, 2) of a total's points in the left photograph as taken, at the first step."""
        return _mapped(self.as_taken, total["xy_reference"] if "xy_reference" in total else self._grid())

    @property
    def as_taken(self) -> Mapping | None:
        """The mapping of pixels of the images in which points are followed to the left photograph as taken, if any."""
        kind: ImageKind = self._result.kind(self.images)  # type: ignore[assignment]
        return to_left_photograph(kind, self._rig())

    def _drawn(self, pixels: np.ndarray) -> np.ndarray:
        import numpy as np

        mapping = self.as_taken if self.photographs != self.images else None
        return np.asarray(_mapped(mapping, pixels), dtype=float)

    def _rig(self) -> Rig | None:
        try:
            source = self._result.source(self.images, "rig", self._variant)
        except KeyError:  # these images were made without a rig
            return None
        return CalibratedRig.read(self._result.product(source, None, self._variant)).cameras

    def _grid(self) -> np.ndarray:
        if self.grid is None:
            raise StoreError("the points of the first step are unknown; run the pipeline again")
        first = self._result.product(self.grid, 0, self._variant)
        return first["xy"] if first.kind == "correlation" else Track.read(first)["points"]


def _mapped(mapping: Mapping | None, pixels: np.ndarray) -> np.ndarray:
    return pixels if mapping is None else mapping(pixels)
