"""What all maps of a test share: one colour range per quantity, one frame for the specimen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field

from dicflow.engine.node import At, Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.comparison import Comparison
from dicflow.kinds.maps import MapQuantity, Positions, StepRanges, colour_range, drawn_at, joined_range
from dicflow.kinds.maps import Maps as MapsProduct
from dicflow.kinds.quantities import ERRORS, QUANTITIES, of_field
from dicflow.kinds.total import Total

if TYPE_CHECKING:
    import numpy as np
__all__ = ["Maps"]


def _field(name: str) -> str:
    if of_field(name) is None:
        known, prefixes = ", ".join(f"'{field}'" for field in QUANTITIES), ", ".join(ERRORS)
        raise ValueError(f"must be {known}, or one of {prefixes} before one of them")
    return name


Quantity = Annotated[str, AfterValidator(_field)]
ColourMap = Literal[
    "viridis", "cividis", "plasma", "inferno", "magma", "turbo", "jet", "coolwarm", "RdBu_r", "Spectral_r", "gray",
    "auto",
]  # fmt: skip


class Maps(Node):
    """Choose the colour range of each quantity over all steps, and the window of the specimen that every map shows.

    The range runs from the least to the largest of the steps' percentiles, so that a few outliers at an edge do
    not take the colours. The pictures themselves are drawn from this product and the totals.
    """

    title: ClassVar = "choose the maps' ranges"
    scope: ClassVar = Scope.TEST
    takes: ClassVar = {
        "total": Port("total", at=At.ALL),
        "comparison": Port("comparison", optional=True),
    }
    gives: ClassVar = "maps"
    impl_version: ClassVar = 2

    stage: Literal["maps"] = "maps"
    quantities: tuple[Quantity, ...] = parameter(
        ("U", "V", "exx", "eyy", "gxy"),
        "what to draw: U, V, W (displacement), exx, eyy, gxy (strain), further fields of the total by name, or the "
        "uncertainty of one: u_exx",
        min_length=1,
    )
    configuration: Literal["deformed", "reference"] = parameter(
        "deformed", "shape in which the specimen is drawn: at each step, or at the first"
    )
    percentile: float = parameter(
        0.5, "share of the points left out at either end of a colour range", unit="%", ge=0, lt=50
    )
    colour_map: ColourMap = parameter(
        "auto",
        "matplotlib's colour map; auto: RdBu_r about zero for values of both signs, else viridis; the thesis used jet",
    )

    pictures: Annotated[int, Field(ge=2)] | Literal["all"] = parameter(
        24, "steps that are drawn: so many, evenly chosen, and those with the extreme values; all for every one"
    )

    def look(self, total: Product) -> Product:
        """Ranges, extent and motion at one step."""
        field = Total.read(total)
        self._check_drawable(field)
        ranges = {name: colour_range(field[name], self.percentile) for name in self.quantities}
        texts = {name: [field.caption(name), field.unit_of(name)] for name in self.quantities}
        extent = _extent(field[self._positions][..., :2])
        return StepRanges.write(ranges, extent, _motion(field), {"unit": field.unit, "texts": texts})

    def run(self, total: Sequence[Product], comparison: Product | None = None) -> Product:
        import numpy as np

        seen = [StepRanges.read(product) for product in total]
        extents = np.array([one["extent"] for one in seen])
        corners = [*extents[:, :2].min(axis=0).tolist(), *extents[:, 2:].max(axis=0).tolist()]
        if not np.isfinite(corners).all():
            raise StageError("no step has a single measured point; look at the tracking and the region of interest")
        found = [one.ranges for one in seen]
        ranges = {name: [one[name] for one in found] for name in self.quantities}
        texts: Mapping[str, tuple[str, str]] = seen[0].facts["texts"]
        quantities = {name: MapQuantity(*texts[name], joined_range(one)) for name, one in ranges.items()}
        phases, unit = _phases([one.motion for one in seen], comparison), seen[0].facts["unit"]
        product = MapsProduct.write(quantities, self._positions, corners, unit, self.colour_map, phases)
        return product if self.pictures == "all" else drawn_at(product, _chosen(ranges, len(total), self.pictures))

    @property
    def _positions(self) -> Positions:
        return "xyz" if self.configuration == "deformed" else "xyz_reference"

    def _check_drawable(self, total: Total) -> None:
        if missing := [name for name in self.quantities if name not in total]:
            drawable = ", ".join([*total.fields, "status"])
            raise StageError(f"the total has no {', '.join(missing)} to draw; it has {drawable}")


def _extent(places: np.ndarray) -> list[float]:
    """Least and largest x and y of places (…, 2), as x_min, y_min, x_max, y_max; infinite without any."""
    import numpy as np

    rows = places.reshape(-1, 2)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        return [np.inf, np.inf, -np.inf, -np.inf]
    return [*rows.min(axis=0).tolist(), *rows.max(axis=0).tolist()]


def _motion(total: Total) -> float:
    """Mean displacement in the plane of the photograph; 0 without any."""
    import numpy as np

    if not np.isfinite(total["U"]).any():
        return 0.0
    return float(np.nan_to_num(np.nanmean(np.hypot(total["U"], total["V"]))))


def _chosen(ranges: Mapping[str, Sequence[tuple[float, float] | None]], count: int, pictures: int) -> list[int]:
    """Numbers of the totals that are drawn: evenly chosen ones, and where a quantity has its least or largest value.

    ranges : quantity → its range at each total; None without a value
    """
    import numpy as np

    found = set(np.linspace(0, count - 1, min(pictures, count)).round().astype(int).tolist())
    for seen in ranges.values():
        known = [(low, high, number) for number, one in enumerate(seen) if one is not None for low, high in [one]]
        found |= {min(known)[2], max(known, key=lambda one: one[1])[2]} if known else set()
    return sorted(found)


def _phases(motion: Sequence[float], comparison: Product | None) -> list[str]:
    """Loading or unloading for each total: by the comparison, else unloading after the largest displacement."""
    import numpy as np

    if comparison is not None:
        return list(Comparison.read(comparison).phases[1:])
    peak = int(np.argmax(motion))
    return ["loading" if index <= peak else "unloading" for index in range(len(motion))]
