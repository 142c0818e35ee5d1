"""MATLAB's MAT, version 5."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable
from pathlib import Path

from scipy.io import savemat

from dicflow._version import __version__
from dicflow.engine.product import Product
from dicflow.io.exports.items import Item, place
from dicflow.io.results import legends

__all__ = ["DESCRIPTION", "KINDS", "write"]

DESCRIPTION = "MATLAB"
KINDS = None
_HEADER_BYTES = 116


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """One file per product: the arrays, the struct ``units``, and ``attributes`` as JSON text."""
    for item in items:
        place(folder, f"{item.stem}.mat").write_bytes(_content(item.chosen))


def _content(product: Product) -> bytes:
    arrays = {name: variable.values for name, variable in product.variables.items()}
    units = {name: variable.units for name, variable in product.variables.items()}
    attributes = json.dumps({"kind": product.kind, **product.attrs, **legends(product)}, ensure_ascii=False)
    buffer = io.BytesIO()
    savemat(
        buffer,
        {**arrays, **({"units": units} if units else {}), "attributes": attributes},
        do_compression=True,
        long_field_names=True,
        oned_as="column",
    )
    return _header() + buffer.getvalue()[_HEADER_BYTES:]


def _header() -> bytes:
    """The text that such a file begins with, without the time of writing: equal products give equal files."""
    return f"MATLAB 5.0 MAT-file, written by dicflow {__version__}".encode().ljust(_HEADER_BYTES)
