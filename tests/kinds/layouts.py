"""What a product holds beside its values, and a product as it comes back from a store."""

from __future__ import annotations

import json

from dicflow.engine.hashing import plain
from dicflow.engine.product import Product


def stored(product: Product) -> Product:
    """The product with its attributes written as JSON and read again, as a store does."""
    return Product(product.kind, product.variables, json.loads(json.dumps(plain(product.attrs), allow_nan=False)))


def layouts(product: Product) -> dict[str, tuple[str, str]]:
    """Array → its axes, parted by blanks, and its unit."""
    return {name: (" ".join(array.dims), array.units) for name, array in product.variables.items()}


def long_names(product: Product) -> dict[str, str]:
    """Array → its name on an axis."""
    return {name: array.long_name for name, array in product.variables.items()}
