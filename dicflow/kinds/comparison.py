"""Lengths and strains compared with a caliper's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from dicflow.engine.product import Product, Variable
from dicflow.kinds.kind import Kind, Layout, Table

if TYPE_CHECKING:
    import numpy as np

__all__ = ["Comparison", "FieldStrain"]

_UNITS = {"_mm": "mm", "_px": "px", "_pct": "%", "_g": "g"}


class FieldStrain(Kind):
    """What a comparison needs of the field at one step."""

    KINDS: ClassVar = ("field_strain",)

    @classmethod
    def write(cls, mean: float, measure: str, follows_material: bool) -> Product:
        """A product of one number.

        mean : strain along the load; NaN without measured points
        measure, follows_material : of the total
        """
        import numpy as np

        facts = {"measure": measure, "follows_material": follows_material}
        return Product("field_strain", {"mean": Variable(("number",), np.array([mean]))}, facts)

    @property
    def mean(self) -> float:
        """Mean strain along the load; NaN without measured points."""
        return float(self["mean"][0])

    @property
    def measure(self) -> str:
        """Measure of strain of the total."""
        return str(self.product.attrs["measure"])

    @property
    def follows_material(self) -> bool:
        """Whether the total follows material points."""
        return bool(self.product.attrs["follows_material"])


class Comparison(Table):
    """One row per step: what the caliper measured, what DIC measured, and the differences."""

    KINDS: ClassVar = ("comparison",)

    @classmethod
    def write(
        cls, table: Mapping[str, np.ndarray], phases: Sequence[str], length: str, summary: Mapping[str, float]
    ) -> Product:
        """A product of columns.

        table : column → (step,); a name ends in the unit, if any; NaN for a step without value
        phases : of each step, loading or unloading
        length : which of the measured lengths is compared
        """
        import numpy as np

        variables = {name: Layout(("step",), _unit(name), name)(values) for name, values in table.items()}
        rows = [
            {
                "phase": phase,
                **{name: float(v[index]) if np.isfinite(v[index]) else None for name, v in table.items()},
            }
            for index, phase in enumerate(phases)
        ]
        return Product("comparison", variables, {"rows": rows, "length": length, "summary": dict(summary)})

    @property
    def phases(self) -> Sequence[str]:
        """Of each step, loading or unloading."""
        return tuple(row["phase"] for row in self.rows)


def _unit(column: str) -> str:
    """Unit at the end of a column's name."""
    return next((unit for ending, unit in _UNITS.items() if column.endswith(ending)), "1")
