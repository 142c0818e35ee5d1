"""The region of interest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from dicflow.engine.product import Product
from dicflow.kinds.kind import Kind

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.photographs.polygon import Polygon

__all__ = ["Region", "polygons_from_json", "polygons_to_json"]


class Region(Kind):
    """The part of the photograph that is measured, in pixels of the image in which points are followed."""

    KINDS: ClassVar = ("region",)

    @classmethod
    def write(cls, polygons: Sequence[Polygon], cuts: Sequence[np.ndarray] = ()) -> Product:
        """A product of outlines with holes [px].

        cuts : lines (n, 2) across which nothing is compared [px]; the outlines have gaps there
        """
        from dicflow.core.photographs.region import area

        area_px = area(polygons)
        attrs = {"polygons": polygons_to_json(polygons), "area_px": area_px, "summary": {"area_px": area_px}}
        return Product("region", {}, attrs | ({"cuts": [line.tolist() for line in cuts]} if cuts else {}))

    @property
    def cuts(self) -> list[np.ndarray]:
        """Lines (n, 2) across which nothing is compared [px]."""
        import numpy as np

        return [np.asarray(line, dtype=float) for line in self.product.attrs.get("cuts", ())]

    @property
    def polygons(self) -> list[Polygon]:
        """Outlines with holes [px]."""
        return polygons_from_json(self.product.attrs["polygons"])

    @property
    def area_px(self) -> float:
        """Area [px²]."""
        return float(self.product.attrs["area_px"])


def polygons_to_json(polygons: Sequence[Polygon], decimals: int = 3) -> list[dict[str, Any]]:
    """Polygons as JSON values: ``{"exterior": [[x, y], …], "holes": [[[x, y], …], …]}`` of each [px]."""
    return [
        {"exterior": p.exterior.round(decimals).tolist(), "holes": [hole.round(decimals).tolist() for hole in p.holes]}
        for p in polygons
    ]


def polygons_from_json(values: Sequence[dict[str, Any]]) -> list[Polygon]:
    """The inverse of :func:`polygons_to_json`."""
    import numpy as np

    from dicflow.core.photographs.polygon import Polygon

    return [
        Polygon(np.asarray(p["exterior"], dtype=float), tuple(np.asarray(hole, dtype=float) for hole in p["holes"]))
        for p in values
    ]
