"""What all kinds of product share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError

if TYPE_CHECKING:
    import numpy as np

__all__ = [
    "GRID",
    "STATUS",
    "Kind",
    "Layout",
    "Table",
    "laid_out",
    "rows_of",
    "steps_of",
    "summary_of",
    "titles_of",
    "warned_if_lost",
]

GRID = ("row", "col")
"""Axes of a field: material points or pixels."""


class Layout(NamedTuple):
    """Axes, unit and name of one array of a product."""

    dims: tuple[str, ...]
    units: str = "1"
    long_name: str = ""

    def __call__(self, values: np.ndarray) -> Variable:
        """The values with these axes, unit and name."""
        return Variable(self.dims, values, self.units, self.long_name)


STATUS = Layout(GRID, "1", "valid, filled, or why the value is unknown")


@dataclass(frozen=True)
class Kind:
    """A product whose arrays and attributes are read by name.

    KINDS : names of the kinds that the class reads; a class that writes one kind writes the first
    """

    KINDS: ClassVar[tuple[str, ...]]

    product: Product

    @classmethod
    def read(cls, product: Product) -> Self:
        """Read a product. Raises StageError for one of another kind."""
        if product.kind not in cls.KINDS:
            raise StageError(f"expected a product of kind {' or '.join(cls.KINDS)}, got {product.kind}")
        return cls(product)

    def __contains__(self, name: object) -> bool:
        return name in self.product

    def __getitem__(self, name: str) -> np.ndarray:
        """The values of one array."""
        return self.product[name]

    @property
    def summary(self) -> Mapping[str, Any]:
        """Scalars of the product by name, as a sweep compares them."""
        return summary_of(self.product)


class Table(Kind):
    """A product that is also a table, as exports and pages show it."""

    @property
    def rows(self) -> Sequence[Mapping[str, Any]]:
        """The rows, each column → value."""
        return tuple(self.product.attrs["rows"])


def summary_of(product: Product) -> Mapping[str, Any]:
    """The scalars of a product of any kind; a name ends in the unit, if any."""
    found: Mapping[str, Any] = product.attrs.get("summary", {})
    return found


def rows_of(product: Product) -> Sequence[Mapping[str, Any]] | None:
    """The rows of a product that is a table; None for any other."""
    found: Sequence[Mapping[str, Any]] | None = product.attrs.get("rows")
    return found


def steps_of(product: Product) -> Sequence[str]:
    """Names of the steps that a product lists; none if it lists none."""
    found: Sequence[str] = product.attrs.get("steps", ())
    return found


def titles_of(product: Product) -> Mapping[str, str]:
    """Array → its title, for arrays of which the product says more than the long name."""
    found: Mapping[str, str] = product.attrs.get("measures", {})
    return found


def warned_if_lost(product: Product) -> Product:
    """The product of points, with a warning if none of them has a value and its stage has not said why."""
    import numpy as np

    from dicflow.core.status import Status

    status = product["status"]
    if product.warnings or (status <= Status.FILLED).any():
        return product
    reasons = status[status != Status.OUTSIDE]
    code = Status(int(np.bincount(reasons).argmax())) if reasons.size else Status.OUTSIDE
    text = f"no point has a value, most are lost for '{code.label}'; look at the photographs"
    return replace(product, attrs={**product.attrs, "warnings": [text]})


def laid_out(layouts: Mapping[str, Layout], values: Mapping[str, np.ndarray]) -> dict[str, Variable]:
    """Arrays by name, each with its layout, in the order of the values."""
    return {name: layouts[name](array) for name, array in values.items()}
