"""Points in space by the pixels of the rectified left image."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from dicflow.engine.product import Product
from dicflow.kinds.kind import GRID, STATUS, Kind, Layout

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.surfaces.displacement import Cloud as CloudField

__all__ = ["Cloud"]


class Cloud(Kind):
    """One point per pixel of a part of the rectified left image, in the left camera's frame [mm]."""

    KINDS: ClassVar = ("cloud",)

    @classmethod
    def write(
        cls,
        xyz: np.ndarray,
        status: np.ndarray,
        origin: tuple[int, int],
        summary: Mapping[str, Any],
        *,
        fit: Mapping[str, Any] | None = None,
        title: str = "position",
    ) -> Product:
        """A product of points.

        xyz : (row, col, 3) — NaN where unknown [mm]; status : (row, col)
        origin : (x, y) of element [0, 0] in the rectified left image [px]
        fit : statistics of the surface of each coordinate, where the points are of one
        """
        import numpy as np

        variables = {
            "xyz": Layout((*GRID, "component"), "mm", title)(xyz.astype(np.float32)),
            "status": STATUS(status),
        }
        known: dict[str, Any] = {} if fit is None else {"fit": dict(fit)}
        return Product("cloud", variables, {"origin": list(origin), **known, "summary": dict(summary)})

    @property
    def origin(self) -> tuple[int, int]:
        """(x, y) of element [0, 0] in the rectified left image [px]."""
        x, y = self.product.attrs["origin"]
        return x, y

    @property
    def fit(self) -> Mapping[str, Any]:
        """Statistics of the surface of each coordinate; empty where the points are not of one."""
        found: Mapping[str, Any] = self.product.attrs.get("fit", {})
        return found

    @property
    def field(self) -> CloudField:
        """The points as :mod:`dicflow.core.surfaces.displacement` takes them."""
        from dicflow.core.surfaces.displacement import Cloud as CloudField

        return CloudField(self["xyz"], self["status"], self.origin)
