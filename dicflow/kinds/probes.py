"""What probes read at every step."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.kinds.kind import Table
from dicflow.kinds.quantities import ERRORS

if TYPE_CHECKING:
    import numpy as np

__all__ = ["ProbeTable", "Reading", "gauge_facts", "main_readings"]


class Reading(NamedTuple):
    """A value, its standard deviation by noise, its remaining bias, and the calibration's share; NaN if unknown."""

    value: float
    sigma: float
    bias: float
    calibration: float

    def parts(self) -> dict[str, float]:
        """The numbers by the prefixes of their names; u combines noise and bias."""
        errors = (self.sigma, self.bias, math.hypot(self.sigma, self.bias), self.calibration)
        return dict(zip(("", *ERRORS), (self.value, *errors), strict=True))


class ProbeTable(Table):
    """Readings of points, lines, areas and extensometers by step, the first step included."""

    KINDS: ClassVar = ("probes",)

    @classmethod
    def write(
        cls,
        variables: Mapping[str, Variable],
        steps: Sequence[str],
        probes: Mapping[str, Sequence[str]],
        rows: Sequence[Mapping[str, Any]],
        facts: Mapping[str, Any],
    ) -> Product:
        """A product of readings.

        variables : (probe, step) of points, lines and areas; (extensometer, step) of lengths; profiles of lines
        steps : names of the steps
        probes : "point", "line", "area", "extensometer" → names
        rows : of the table, one per probe and step
        facts : further attributes, of the total: unit, measures, gauge; and the summary
        """
        listed = {kind: list(names) for kind, names in probes.items()}
        attrs = {"steps": list(steps), "probes": listed, "rows": [dict(row) for row in rows]}
        return Product("probes", variables, {**attrs, **facts})

    @property
    def unit(self) -> str:
        """Unit of lengths: mm, or px with one camera."""
        return str(self.product.attrs["unit"])

    @property
    def extensometers(self) -> Sequence[str]:
        """Names of the extensometers."""
        return tuple(self.product.attrs["probes"]["extensometer"])

    @property
    def areas(self) -> Sequence[str]:
        """Names of the areas."""
        return tuple(self.product.attrs["probes"]["area"])

    def of_extensometer(self, name: str, quantity: str) -> np.ndarray:
        """A quantity of one extensometer at every step. Raises StageError for an unknown name."""
        if name not in self.extensometers:
            known = ", ".join(self.extensometers) or "none"
            raise StageError(f"unknown extensometer '{name}'; the probes have: {known}")
        values: np.ndarray = self[quantity][self.extensometers.index(name)]
        return values

    def of_area(self, name: str, quantity: str) -> np.ndarray:
        """A quantity of one area at every step. Raises StageError for an unknown name or quantity."""
        if name not in self.areas:
            raise StageError(f"unknown area '{name}'; the probes have: {', '.join(self.areas) or 'none'}")
        if quantity not in self:
            raise StageError(f"the probes do not read {quantity}; add it to their quantities")
        listed = self.product.attrs["probes"]
        values: np.ndarray = self[quantity][[*listed["point"], *listed["line"], *listed["area"]].index(name)]
        return values


def main_readings(row: Mapping[str, Any]) -> Iterator[tuple[str, float | None, float | None]]:
    """Quantity, value and uncertainty u of what a row of the table is mostly read for; None where it is unknown.

    Of an extensometer its strain; of other probes exx and eyy, or else all that they read.
    """
    names = [name for name in ("strain", "exx", "eyy") if name in row]
    others = [name.removeprefix("u_") for name in row if name.startswith("u_")]
    for name in names or others:
        yield name, row[name], row.get(f"u_{name}")


def gauge_facts(total: Product) -> dict[str, Any]:
    """Attributes of a total that its tables repeat: unit, measures of strain, virtual strain gauge."""
    return {name: total.attrs[name] for name in ("unit", "measures", "vsg_px", "vsg_mm") if name in total.attrs}
