"""Colours that stand for values: one table and one range per quantity, for all that draw it."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dicflow.core.status import Status
from dicflow.discovery import nearest
from dicflow.errors import ConfigurationError
from dicflow.kinds.quantities import is_signed
from dicflow.views.colour_tables import TABLES

__all__ = ["DIVERGING", "REASON_COLOURS", "Look", "look", "palette"]

SEQUENTIAL, DIVERGING = "viridis", "RdBu_r"
_SIGNED = 0.1

REASON_COLOURS = {
    Status.FILLED: "#f5d442",
    Status.OUTSIDE: "#8c8c8c",
    Status.LOW_TEXTURE: "#1f5fb4",
    Status.NO_MATCH: "#d62728",
    Status.LEFT_RIGHT: "#ff8c1a",
    Status.SPECKLE: "#9467bd",
    Status.BACKGROUND: "#7f4f3a",
    Status.UNTRACKED: "#e377c2",
    Status.TOO_FEW_NEIGHBOURS: "#17becf",
    Status.NOT_CONVERGED: "#a50f15",
    Status.LOW_CORRELATION: "#fb9a99",
    Status.EPIPOLAR: "#33a02c",
    Status.HIDDEN: "#252525",
    Status.CUT_SUBSET: "#a6cee3",
    Status.OVEREXPOSED: "#bcf60c",
    Status.MISFIT: "#808000",
    Status.OUTLIER: "#f032e6",
    Status.DISCONTINUITY: "#5b3256",
    Status.UNEVEN_LIGHT: "#ffe119",
    Status.BLURRED: "#aaffc3",
}
"""Colour of each status of a point without a measured value."""


class Look(NamedTuple):
    """How a quantity is shown.

    quantity : name of the array
    title : the measure in words
    unit : of its values; "1" for a pure number
    range : colours run between these two values
    table : name of a matplotlib colour map
    """

    quantity: str
    title: str
    unit: str
    range: tuple[float, float]
    table: str

    @property
    def label(self) -> str:
        """The measure with its unit, as on a colour bar."""
        return f"{self.title} [{'–' if self.unit == '1' else self.unit}]"


def look(quantity: str, title: str, unit: str, low: float, high: float, choice: str = "auto") -> Look:
    """The look of a quantity whose values run from ``low`` to ``high``.

    choice : a matplotlib colour map; "auto" takes a diverging one about zero for a quantity whose signs mean opposite
        things and whose values lie on both sides, the smaller at least a tenth of the larger, else a sequential one
    """
    if choice != "auto":
        return Look(quantity, title, unit, (low, high), choice)
    largest, smallest = max(abs(low), abs(high)), min(abs(low), abs(high))
    if is_signed(quantity) and low < 0 < high and smallest >= _SIGNED * largest:
        return Look(quantity, title, unit, (-largest, largest), DIVERGING)
    return Look(quantity, title, unit, (low, high), SEQUENTIAL)


@cache
def palette(table: str, count: int = 254) -> NDArray[np.uint8]:
    """Colours of a table from its low to its high end.

    Returns (count, 3) uint8 RGB, read-only. Raises ConfigurationError for a table that matplotlib does not have.
    """
    found = _kept_colours(table, count) if table in TABLES else _colours_of_matplotlib(table, count)
    found.flags.writeable = False
    return found


def _kept_colours(table: str, count: int) -> NDArray[np.uint8]:
    kept = np.frombuffer(TABLES[table], np.uint8).reshape(-1, 3)
    found: NDArray[np.uint8] = kept[np.minimum(np.linspace(0, len(kept), count).astype(int), len(kept) - 1)]
    return found


def _colours_of_matplotlib(table: str, count: int) -> NDArray[np.uint8]:
    import matplotlib

    if table not in matplotlib.colormaps:
        near = nearest(table, matplotlib.colormaps)
        raise ConfigurationError(f"no colour map '{table}'{near}; choose one of matplotlib's")
    colours = matplotlib.colormaps[table](np.linspace(0, 1, count), bytes=True)
    found: NDArray[np.uint8] = np.ascontiguousarray(colours[:, :3])
    return found
