"""Bias and scatter of each quantity at steps without deformation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from dicflow.engine.product import Product
from dicflow.kinds.kind import Layout, Table

if TYPE_CHECKING:
    import numpy as np

__all__ = ["NoiseFloorTable"]


class NoiseFloorTable(Table):
    """Figures of each quantity by step."""

    KINDS: ClassVar = ("noise",)

    @classmethod
    def write(
        cls,
        figures: Mapping[str, np.ndarray],
        steps: Sequence[str],
        quantities: Sequence[str],
        rows: Sequence[Mapping[str, Any]],
        facts: Mapping[str, Any],
    ) -> Product:
        """A product of figures.

        figures : bias, sigma and predicted_sigma → (quantity, step)
        rows : of the table, one per step and quantity
        facts : further attributes: unit, measures, gauge, rigid, summary
        """
        variables = {name: Layout(("quantity", "step"), "1", name)(values) for name, values in figures.items()}
        attrs = {"steps": list(steps), "quantities": list(quantities), "rows": [dict(row) for row in rows]}
        return Product("noise", variables, {**attrs, **facts})

    @property
    def unit(self) -> str:
        """Unit of displacements: mm, or px with one camera."""
        return str(self.product.attrs["unit"])
