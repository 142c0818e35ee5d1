"""The parts of a material grid in a product whose own arrays do not hold the places of its points at the first step."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from dicflow.engine.product import Product
from dicflow.kinds.kind import GRID, Layout

if TYPE_CHECKING:
    from dicflow.core.parts import Parts

__all__ = ["parts_in", "with_parts"]

_NUMBER = Layout(GRID, "1", "number of the part; 0 outside the region")
_PLACES = Layout((*GRID, "image_component"), "px", "place in the first photograph")


def with_parts(product: Product, parts: Parts | None) -> Product:
    """The product with the parts of its grid; unchanged for a single one."""
    if parts is None or parts.is_single:
        return product
    variables = {**product.variables, "part": _NUMBER(parts.number), "part_places": _PLACES(parts.places)}
    return replace(product, variables=variables, attrs={**product.attrs, "cuts": parts.cuts.tolist()})


def parts_in(product: Product) -> Parts | None:
    """The parts of a product's grid; None for a single one."""
    import numpy as np

    from dicflow.core.parts import Parts

    if "part" not in product:
        return None
    cuts = np.array(product.attrs["cuts"], dtype=float).reshape(-1, 4)
    return Parts(product["part"], np.ascontiguousarray(product["part_places"]), cuts)
