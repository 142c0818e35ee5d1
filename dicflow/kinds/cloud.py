"""Points in space by the pixels of the rectified left image."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from dicflow.engine.product import Product
from dicflow.kinds.kind import GRID, STATUS, Kind, Layout, laid_out

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.surfaces.displacement import Cloud as CloudField

__all__ = ["Cloud"]

_LAYOUTS = {"xyz": Layout((*GRID, "component"), "mm", "position"), "status": STATUS}


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
        title: str = _LAYOUTS["xyz"].long_name,
        warnings: Sequence[str] = (),
    ) -> Product:
        """A product of points.

        xyz : (row, col, 3) — NaN where unknown [mm]; status : (row, col)
        origin : (x, y) of element [0, 0] in the rectified left image [px]
        fit : statistics of the surface fitted to each coordinate; None for measured points
        title : long name of the points
        warnings : sentences for the user
        """
        import numpy as np

        layouts = _LAYOUTS | {"xyz": _LAYOUTS["xyz"]._replace(long_name=title)}
        values = {"xyz": xyz.astype(np.float32), "status": status}
        known: dict[str, Any] = {} if fit is None else {"fit": dict(fit)}
        attrs: dict[str, Any] = {"origin": list(origin), **known, "summary": dict(summary)}
        attrs |= {"warnings": list(warnings)} if warnings else {}
        return Product("cloud", laid_out(layouts, values), attrs)

    @property
    def origin(self) -> tuple[int, int]:
        """(x, y) of element [0, 0] in the rectified left image [px]."""
        x, y = self.product.attrs["origin"]
        return x, y

    @property
    def title(self) -> str:
        """Long name of the points: measured positions, or a surface fitted to them."""
        return self.product.variables["xyz"].long_name

    @property
    def fit(self) -> Mapping[str, Any]:
        """Statistics of the surface fitted to each coordinate; empty for measured points."""
        statistics: Mapping[str, Any] = self.product.attrs.get("fit", {})
        return statistics

    @property
    def field(self) -> CloudField:
        """The points as :mod:`dicflow.core.surfaces.displacement` takes them."""
        from dicflow.core.surfaces.displacement import Cloud as CloudField

        return CloudField(self["xyz"], self["status"], self.origin)
