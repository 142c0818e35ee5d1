"""Photographs of one step: as the cameras took them, with aligned rows, or without distortion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.kind import GRID, Kind, Layout

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.camera import Rig

__all__ = ["Images", "check_size"]

_TITLES = {
    "images": "{side} photograph",
    "rectified": "rectified {side} photograph",
    "plane": "undistorted photograph",
}
_COUNTS = Layout(GRID, "1", "whether a pixel is measured")


_NONE: Mapping[str, Any] = MappingProxyType({})


class Images(Kind):
    """Grey levels (row, col) of the left photograph and, with two cameras, of the right one.

    A photograph with pixels that must not be measured, such as transparent ones, has a mask beside it; most have none.
    """

    KINDS: ClassVar = ("images", "rectified", "plane")

    @classmethod
    def write(
        cls,
        left: np.ndarray,
        right: np.ndarray | None = None,
        kind: Literal["images", "rectified", "plane"] = "images",
        counts: Mapping[str, np.ndarray] = _NONE,
        notes: Mapping[str, str] = _NONE,
        time: float | None = None,
        utc_offset: float | None = None,
    ) -> Product:
        """A product of photographs.

        left, right : (row, col) — grey levels; ``right`` is None with one camera
        kind : as taken, with aligned rows, or the left one without distortion
        counts : left or right → (row, col) bool, False for pixels that are not measured. A mask that is True
            everywhere is left out
        notes : left or right → a sentence about the photograph that people need to know
        time : of the left photograph [s]; None if unknown
        utc_offset : what the camera's clock shows more than UTC [s]; None if unknown
        """
        sides = {"left": left} if right is None else {"left": left, "right": right}
        grey = Layout(GRID, "grey level", _TITLES[kind])
        known = {"notes": dict(notes) or None, "time": time, "utc_offset": utc_offset}
        masks = {f"{side}_counts": _COUNTS(counts[side]) for side in sides if side in counts and not counts[side].all()}
        return Product(
            kind,
            {side: grey._replace(long_name=grey.long_name.format(side=side))(image) for side, image in sides.items()}
            | masks,
            {name: value for name, value in known.items() if value is not None},
        )

    @property
    def left(self) -> np.ndarray:
        """Grey levels (row, col) of the left photograph."""
        return self["left"]

    @property
    def right(self) -> np.ndarray:
        """Grey levels (row, col) of the right photograph. Raises StageError with one camera."""
        if not self.has_right:
            raise StageError("expected photographs of two cameras, found only left ones; add 'right' to the images")
        return self["right"]

    def counts(self, side: str) -> np.ndarray | None:
        """Pixels (row, col) of the left or right photograph that are measured; None if all are."""
        return self[f"{side}_counts"] if f"{side}_counts" in self.product else None

    @property
    def masks(self) -> dict[str, np.ndarray]:
        """The masks of the photographs in which not all pixels are measured, by left or right."""
        return {side: mask for side in ("left", "right") if (mask := self.counts(side)) is not None}

    @property
    def notes(self) -> Mapping[str, str]:
        """Left or right → a sentence about the photograph that people need to know, if there is one."""
        found: Mapping[str, str] = self.product.attrs.get("notes", {})
        return found

    @property
    def time(self) -> float | None:
        """When the left photograph was taken [s], by the clock of its camera; None if unknown.

        Of a video the seconds count from its first frame, of photographs from 1970: only differences have a meaning.
        """
        found: float | None = self.product.attrs.get("time")
        return found

    @property
    def utc_offset(self) -> float | None:
        """What the clock of :attr:`time` shows more than UTC [s]; None if unknown."""
        found: float | None = self.product.attrs.get("utc_offset")
        return found

    @property
    def has_right(self) -> bool:
        """Whether there are two cameras."""
        return "right" in self

    @property
    def as_taken(self) -> bool:
        """Whether these are the cameras' own photographs, neither rectified nor undistorted."""
        return self.product.kind == "images"

    @property
    def sides(self) -> Iterator[tuple[str, np.ndarray]]:
        """Each camera's name, left or right, and its photograph."""
        return ((side, self[side]) for side in ("left", "right") if side in self)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the left photograph [px]."""
        height, width = self.left.shape
        return width, height

    def check_sizes(self, rig: Rig) -> None:
        """Raise StageError where a camera was calibrated on photographs of another size."""
        for side, camera in (("left", rig.left), ("right", rig.right)):
            height, width = (self.left if side == "left" else self.right).shape
            check_size(side, camera.size, (width, height))


def check_size(side: str, camera_size: tuple[int, int], size: tuple[int, int]) -> None:
    """Raise StageError where a camera was calibrated on photographs of another size (width, height) [px]."""
    if tuple(size) != tuple(camera_size):
        raise StageError(
            f"the {side} camera was calibrated on photographs of {camera_size[0]} × {camera_size[1]} px, but this one "
            f"has {size[0]} × {size[1]} px; photograph the board with the settings used for the specimen, or set "
            "offset in the stage of the rig if the window of the sensor was set smaller since"
        )
