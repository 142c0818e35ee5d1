"""What probes read at every step."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.kinds.kind import Kind, Table
from dicflow.kinds.quantities import ERRORS

if TYPE_CHECKING:
    import numpy as np

__all__ = ["ProbeTable", "Reading", "StepReadings", "gauge_facts", "main_readings"]


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


class StepReadings(Kind):
    """What probes read at one step, and quantities along lines, (line, sample)."""

    KINDS: ClassVar = ("readings",)

    @classmethod
    def write(
        cls,
        readings: Sequence[Mapping[str, Mapping[str, Reading]]],
        profiles: Mapping[str, np.ndarray],
        facts: Mapping[str, Any],
    ) -> Product:
        """A product of readings.

        readings : groups of probes that read the same: probe → quantity → reading
        profiles : quantity → (line, sample)
        facts : of the total
        """
        import numpy as np

        groups = [group for group in readings if group]
        listed = [[list(group), list(next(iter(group.values())))] for group in groups]
        variables = {
            f"readings_{k}": Variable(
                (f"probe_{k}", f"quantity_{k}", "part"),
                np.array([[group[probe][name] for name in names] for probe in probes], dtype=float),
            )
            for k, (group, (probes, names)) in enumerate(zip(groups, listed, strict=True))
        }
        along = {f"profile_{name}": Variable(("line", "sample"), values) for name, values in profiles.items()}
        return Product("readings", {**variables, **along}, {"groups": listed, "facts": dict(facts)})

    @property
    def readings(self) -> dict[str, dict[str, Reading]]:
        """Probe → quantity → reading."""
        return {
            probe: {name: Reading(*parts) for name, parts in zip(names, row, strict=True)}
            for k, (probes, names) in enumerate(self.product.attrs["groups"])
            for probe, row in zip(probes, self[f"readings_{k}"].tolist(), strict=True)
        }

    @property
    def profiles(self) -> dict[str, np.ndarray]:
        """Quantity → values along lines, (line, sample)."""
        named = (name for name in self.product.variables if name.startswith("profile_"))
        return {name.removeprefix("profile_"): self[name] for name in named}

    @property
    def facts(self) -> dict[str, Any]:
        """Facts of the total."""
        return dict(self.product.attrs["facts"])


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
        facts : further attributes, of the total: unit, measures, gauge; the summary; and "unmeasured": probe without a
            value at any step → why
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
        """A quantity of one extensometer at every step. Raises StageError for one that is unknown, or has no value."""
        if name not in self.extensometers:
            known = ", ".join(self.extensometers) or "none"
            raise StageError(f"unknown extensometer '{name}'; the probes have: {known}")
        self._check_measured(name)
        values: np.ndarray = self[quantity][self.extensometers.index(name)]
        return values

    def of_area(self, name: str, quantity: str) -> np.ndarray:
        """A quantity of one area at every step. Raises StageError for one that is unknown, not read or not measured."""
        if name not in self.areas:
            raise StageError(f"unknown area '{name}'; the probes have: {', '.join(self.areas) or 'none'}")
        if quantity not in self:
            raise StageError(f"the probes do not read {quantity}; add it to their quantities")
        self._check_measured(name)
        listed = self.product.attrs["probes"]
        values: np.ndarray = self[quantity][[*listed["point"], *listed["line"], *listed["area"]].index(name)]
        return values

    def _check_measured(self, name: str) -> None:
        reason = self.product.attrs.get("unmeasured", {}).get(name)
        if reason is not None:
            raise StageError(f"probe '{name}' {reason}")


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
