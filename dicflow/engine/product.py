"""Products: the outputs of stages, which are inputs of later ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    import xarray

__all__ = ["Product", "Variable", "stacked", "unstacked"]


class Variable(NamedTuple):
    """One array of a product.

    dims : names of the axes, one per axis of ``values``
    values : the array
    units : unit of the values, ``"1"`` for pure numbers and codes
    long_name : label of an axis that shows it
    """

    dims: tuple[str, ...]
    values: np.ndarray
    units: str = "1"
    long_name: str = ""


@dataclass(frozen=True)
class Product:
    """A named set of arrays plus plain attributes.

    kind : name by which inputs and outputs are matched ("rig", "disparity", …)
    variables : the arrays by name; a product from a store reads an array at its first use
    attrs : JSON values only. The entry ``summary``, if present, maps names to the scalars of this product
        that a sweep's table compares; a name ends in its unit where it has one (``residual_px``). The entry
        ``warnings``, if present, lists whole sentences that a user must see whenever the product is used; equal
        ones of several steps are shown once, so that a sentence names no step
    """

    kind: str
    variables: Mapping[str, Variable] = field(default_factory=dict)
    attrs: Mapping[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        """The values of one array."""
        return self.variables[name].values

    def __contains__(self, name: object) -> bool:
        return name in self.variables

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user must know of this product."""
        found = self.attrs.get("warnings", ())
        return (found,) if isinstance(found, str) else tuple(map(str, found))

    @property
    def nbytes(self) -> int:
        """Size of all arrays in memory [bytes]."""
        return sum(variable.values.nbytes for variable in self.variables.values())

    def to_dataset(self) -> xarray.Dataset:
        """The same as an xarray dataset, with ``units`` and ``long_name`` on every array.

        If arrays differ in length along a dimension, as for a board that only one camera sees, its name gets the
        length.
        """
        import xarray

        lengths: dict[str, set[int]] = {}
        for v in self.variables.values():
            for dim, length in zip(v.dims, v.values.shape, strict=True):
                lengths.setdefault(dim, set()).add(length)

        def named(v: Variable) -> list[str]:
            sizes = zip(v.dims, v.values.shape, strict=True)
            return [dim if len(lengths[dim]) == 1 else f"{dim}_{length}" for dim, length in sizes]

        arrays = {
            name: (named(v), v.values, {"units": v.units, "long_name": v.long_name or name})
            for name, v in self.variables.items()
        }
        return xarray.Dataset(arrays, attrs={"kind": self.kind, **self.attrs})


def stacked(kind: str, products: Mapping[str, Product]) -> Product:
    """Products of one layout as one product of a kind, their arrays along a first axis.

    products : by name, one at least; arrays of one name have one shape
    """
    import numpy as np

    first, *_ = products.values()
    variables = {
        name: Variable(("product", *one.dims), np.stack([two[name] for two in products.values()]), *one[2:])
        for name, one in first.variables.items()
    }
    return Product(kind, variables, {"products": [[name, one.kind, one.attrs] for name, one in products.items()]})


def unstacked(product: Product) -> Iterator[tuple[str, Product]]:
    """The products that :func:`stacked` joined, with their names."""
    arrays = {name: one._replace(dims=one.dims[1:]) for name, one in product.variables.items()}
    for place, (name, kind, attrs) in enumerate(product.attrs["products"]):
        yield name, Product(kind, {key: one._replace(values=one.values[place]) for key, one in arrays.items()}, attrs)
