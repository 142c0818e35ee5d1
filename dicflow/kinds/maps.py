"""Colour ranges and extent that all maps of a test share."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

from dicflow.engine.product import Product, Variable
from dicflow.kinds.kind import Kind

if TYPE_CHECKING:
    import numpy as np

__all__ = ["MapQuantity", "Maps", "Positions", "StepRanges", "colour_range", "drawn_at", "joined_range", "positions_in"]

Positions = Literal["xyz", "xyz_reference"]


class MapQuantity(NamedTuple):
    """What all maps of one quantity share.

    title : name in words
    unit : of its values
    range : least and largest value that has a colour of its own
    """

    title: str
    unit: str
    range: tuple[float, float]


class StepRanges(Kind):
    """What maps need of one step: the colour range of each quantity, where points lie, and how far they have moved."""

    KINDS: ClassVar = ("ranges",)

    @classmethod
    def write(
        cls,
        ranges: Mapping[str, tuple[float, float] | None],
        extent: Sequence[float],
        motion: float,
        facts: Mapping[str, Any],
    ) -> Product:
        """A product of ranges.

        ranges : quantity → range; None without a value
        extent : x_min, y_min, x_max, y_max; infinite without a place
        motion : mean displacement; 0 without any
        facts : of the total
        """
        import numpy as np

        pairs = [(np.nan, np.nan) if one is None else one for one in ranges.values()]
        variables = {
            "ranges": Variable(("quantity", "side"), np.array(pairs, dtype=float)),
            "extent": Variable(("corner",), np.array(extent, dtype=float)),
            "motion": Variable(("number",), np.array([motion])),
        }
        return Product("ranges", variables, {"quantities": list(ranges), "facts": dict(facts)})

    @property
    def ranges(self) -> dict[str, tuple[float, float] | None]:
        """Quantity → range; None without a value."""
        pairs = zip(self.product.attrs["quantities"], self["ranges"].tolist(), strict=True)
        return {name: None if low != low else (low, high) for name, (low, high) in pairs}

    @property
    def motion(self) -> float:
        """Mean displacement; 0 without any."""
        return float(self["motion"][0])

    @property
    def facts(self) -> Mapping[str, Any]:
        """Facts of the total."""
        found: Mapping[str, Any] = self.product.attrs["facts"]
        return found


class Maps(Kind):
    """Colour range of each quantity over all steps, and the window of the specimen that every map shows."""

    KINDS: ClassVar = ("maps",)

    @classmethod
    def write(
        cls,
        quantities: Mapping[str, MapQuantity],
        positions: Positions,
        extent: Sequence[float],
        unit: str,
        colour_map: str,
        phases: Sequence[str],
    ) -> Product:
        """A product of ranges.

        positions : array of the total that says where a point is drawn
        extent : x_min, y_min, x_max, y_max over all steps [unit]
        colour_map : matplotlib's name, or auto
        phases : of each total, loading or unloading
        """
        listed: dict[str, Any] = {name: {**q._asdict(), "range": list(q.range)} for name, q in quantities.items()}
        attrs = {
            "quantities": listed,
            "positions": positions,
            "extent": list(extent),
            "unit": unit,
            "colour_map": colour_map,
            "phases": list(phases),
        }
        return Product("maps", attrs=attrs)

    @property
    def quantities(self) -> Mapping[str, MapQuantity]:
        """Name of the array → what its maps share."""
        found: Mapping[str, Mapping[str, Any]] = self.product.attrs["quantities"]
        return {
            name: MapQuantity(values["title"], values["unit"], (values["range"][0], values["range"][1]))
            for name, values in found.items()
        }

    @property
    def positions(self) -> Positions:
        """Array of the total that says where a point is drawn."""
        found: Positions = self.product.attrs["positions"]
        return found

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """x_min, y_min, x_max, y_max over all steps, in the unit of length."""
        x0, y0, x1, y1 = self.product.attrs["extent"]
        return x0, y0, x1, y1

    @property
    def unit(self) -> str:
        """Unit of length: mm, or px with one camera."""
        return str(self.product.attrs["unit"])

    @property
    def colour_map(self) -> str:
        """matplotlib's name, or auto."""
        return str(self.product.attrs["colour_map"])

    @property
    def phases(self) -> Sequence[str]:
        """Of each total, loading or unloading."""
        return tuple(self.product.attrs["phases"])

    @property
    def drawn(self) -> Sequence[int]:
        """Numbers of the totals that are drawn; the others of a long series have no pictures."""
        return tuple(self.product.attrs.get("drawn", range(len(self.phases))))


def drawn_at(product: Product, numbers: Sequence[int]) -> Product:
    """The product of maps of which only some totals are drawn; unchanged if these are all."""
    if len(numbers) == len(product.attrs["phases"]):
        return product
    return replace(product, attrs={**product.attrs, "drawn": list(numbers)})


def positions_in(arrays: Container[str]) -> Literal["xyz", "xy"]:
    """The array of a total with the places of its points: those on the specimen, else those in the image."""
    return "xyz" if "xyz" in arrays else "xy"


LEFT_OUT_PERCENT = 0.5
"""Share of the points left out at either end of a colour range, so that a few outliers do not use up the colours."""


def colour_range(values: np.ndarray, left_out_percent: float = LEFT_OUT_PERCENT) -> tuple[float, float] | None:
    """The range of all values but a few outliers; None if no value is known.

    values : of any shape; NaN does not count
    left_out_percent : share of the values left out at either end [%]
    """
    import numpy as np

    known = values[np.isfinite(values)]
    if not known.size:
        return None
    low, high = np.percentile(known, [left_out_percent, 100 - left_out_percent]).tolist()
    return low, high


def joined_range(ranges: Iterable[tuple[float, float] | None]) -> tuple[float, float]:
    """The range over several steps, from the least to the largest, as two different numbers.

    Steps without a range are None; without any the range is −1 … 1.
    """
    known = [one for one in ranges if one is not None]
    if not known:
        return -1.0, 1.0
    low, high = min(one[0] for one in known), max(one[1] for one in known)
    return (low, high) if high - low > 1e-12 else (low - 0.5e-6, high + 0.5e-6)
