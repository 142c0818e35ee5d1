"""Millimetres per pixel of one camera that looks at a plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from dicflow.engine.product import Product
from dicflow.kinds.kind import Kind

__all__ = ["Scale"]


class Scale(Kind):
    """The scale of the specimen's plane."""

    KINDS: ClassVar = ("scale",)

    @classmethod
    def write(
        cls, mm_per_px: float, u_mm_per_px: float, stand_off_mm: float | None, warnings: Sequence[str]
    ) -> Product:
        """A product of a scale.

        u_mm_per_px : its standard uncertainty
        stand_off_mm : distance of the camera from the specimen; None if unknown
        """
        summary = {"mm_per_px": mm_per_px, "u_mm_per_px": u_mm_per_px, "u_percent": 100.0 * u_mm_per_px / mm_per_px}
        if stand_off_mm is not None:
            summary["stand_off_mm"] = stand_off_mm
        return Product("scale", {}, {"stand_off_mm": stand_off_mm, "summary": summary, "warnings": list(warnings)})

    @property
    def mm_per_px(self) -> float:
        """Size of a pixel on the specimen [mm]."""
        return float(self.summary["mm_per_px"])

    @property
    def relative_u(self) -> float:
        """Standard uncertainty of the scale over the scale; that of every length by it."""
        return float(self.summary["u_mm_per_px"]) / self.mm_per_px

    @property
    def stand_off_mm(self) -> float | None:
        """Distance of the camera from the specimen [mm]; None if unknown."""
        found: float | None = self.product.attrs["stand_off_mm"]
        return found

    @property
    def facts(self) -> Mapping[str, Any]:
        """What a total in millimetres keeps of it."""
        return {"mm_per_px": self.mm_per_px, "relative_u": self.relative_u, "stand_off_mm": self.stand_off_mm}
