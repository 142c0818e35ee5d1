"""What machines beside the cameras measured at every step: force, crosshead, temperature, time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.kinds.kind import Table, steps_of

if TYPE_CHECKING:
    import numpy as np

__all__ = ["Channel", "Channels", "named_with_unit"]


class Channel(NamedTuple):
    """One quantity at every step.

    values : (step,), NaN where unknown
    unit : of the values: N for forces, mm for lengths, s for times, °C for temperatures …
    title : the quantity in words
    u : (step,) — standard uncertainty in the same unit; None if unknown
    reasons : of each step, why its value is unknown, as a sentence; empty where it is known
    """

    values: np.ndarray
    unit: str
    title: str
    u: np.ndarray | None = None
    reasons: Sequence[str] = ()


class Channels(Table):
    """Channels by name, one value per step, the first step included.

    The channel that loads the specimen has a name of its own (:attr:`load`), and decides which steps belong to loading
    and which to unloading.
    """

    KINDS: ClassVar = ("channels",)

    @classmethod
    def write(
        cls,
        channels: Mapping[str, Channel],
        steps: Sequence[str],
        load: str | None = None,
        phases: Sequence[str] = (),
        facts: Mapping[str, Any] | None = None,
    ) -> Product:
        """A product of channels.

        channels : by name
        steps : names of all steps, the first included
        load : name of the channel with the load on the specimen; None without one
        phases : of each step, loading or unloading; empty if unknown
        facts : further attributes: the summary, warnings
        """
        variables: dict[str, Variable] = {}
        reasons: dict[str, list[str]] = {}
        for name, channel in channels.items():
            variables[name] = Variable(("step",), channel.values, channel.unit, channel.title)
            if channel.u is not None:
                title = f"standard uncertainty of {channel.title}"
                variables[f"u_{name}"] = Variable(("step",), channel.u, channel.unit, title)
            if any(channel.reasons):
                reasons[name] = list(channel.reasons)
        attrs = {
            "steps": list(steps),
            "names": list(channels),
            "load": load,
            "phases": list(phases),
            "reasons": reasons,
            "rows": _rows(channels, steps, phases),
        }
        return Product("channels", variables, {**attrs, **(facts or {})})

    @property
    def steps(self) -> Sequence[str]:
        """Names of all steps, the first included."""
        return tuple(steps_of(self.product))

    @property
    def names(self) -> Sequence[str]:
        """Names of the channels."""
        return tuple(self.product.attrs["names"])

    @property
    def load(self) -> str:
        """Name of the channel with the load on the specimen. Raises StageError without a load."""
        found = self.product.attrs["load"]
        if found is None:
            raise StageError(
                f"no channel is the load; set load in the stage 'channels' to one of: {', '.join(self.names) or 'none'}"
            )
        return str(found)

    @property
    def has_load(self) -> bool:
        """Whether one of the channels is the load on the specimen."""
        return self.product.attrs["load"] is not None

    @property
    def phases(self) -> Sequence[str]:
        """Of each step, loading or unloading; empty if unknown."""
        return tuple(self.product.attrs["phases"])

    def columns_at(self, steps: Sequence[str]) -> dict[str, list[float | None]]:
        """Column → value at each of some steps, None where unknown; a column is a channel with its unit.

        steps : names; "reference" is the first step
        """
        rows = self._rows_by_step()
        columns = [named_with_unit(name, self.product.variables[name].units) for name in self.names]
        return {column: [rows.get(step, {}).get(column) for step in steps] for column in columns}

    def phases_at(self, steps: Sequence[str]) -> Sequence[str]:
        """Loading or unloading at each of some steps, named as for :meth:`columns_at`; empty if unknown for one."""
        rows = self._rows_by_step()
        found = [rows.get(step, {}).get("phase") for step in steps]
        return [phase for phase in found if phase] if all(found) else []

    def _rows_by_step(self) -> dict[str, Mapping[str, Any]]:
        rows = {row["step"]: row for row in self.rows}
        return {"reference": rows[self.steps[0]], **rows} if rows else {}

    def of(self, name: str) -> Channel:
        """One channel. Raises StageError for an unknown name."""
        if name not in self.names:
            raise StageError(f"no channel '{name}'; there are: {', '.join(self.names) or 'none'}")
        variable = self.product.variables[name]
        found = self.product.variables.get(f"u_{name}")
        u = None if found is None else found.values
        reasons = self.product.attrs["reasons"].get(name, [""] * len(self.steps))
        return Channel(variable.values, variable.units, variable.long_name, u, tuple(reasons))


def named_with_unit(name: str, unit: str) -> str:
    """Name of a column: the channel's, with the unit at its end."""
    return name if unit == "1" else f"{name}_{_ENDINGS.get(unit, unit)}"


_ENDINGS = {"°C": "degC", "mm/s": "mm_per_s", "1/s": "per_s"}
"""Units that stand otherwise in the name of a column."""


def _rows(channels: Mapping[str, Channel], steps: Sequence[str], phases: Sequence[str]) -> list[dict[str, Any]]:
    """One row per step: its name, its phase if known, each channel and its uncertainty."""
    columns: dict[str, np.ndarray] = {}
    for name, channel in channels.items():
        columns[named_with_unit(name, channel.unit)] = channel.values
        if channel.u is not None:
            columns[named_with_unit(f"u_{name}", channel.unit)] = channel.u
    return [
        {
            "step": step,
            **({"phase": phases[index]} if phases else {}),
            **{column: _json(values[index]) for column, values in columns.items()},
        }
        for index, step in enumerate(steps)
    ]


def _json(value: float) -> float | None:
    """The value; None for NaN and infinity, which JSON lacks."""
    return float(value) if math.isfinite(value) else None
