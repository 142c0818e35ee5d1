"""HDF5: one file, a group per stage and in it one per step."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import h5py

from dicflow._version import __version__
from dicflow.engine.product import Product
from dicflow.io.exports.items import Item, file_stem, place
from dicflow.kinds.status import STATUS_NAME, status_attributes

__all__ = ["DESCRIPTION", "KINDS", "write"]

DESCRIPTION = "one file for all"
KINDS = None


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """All products in one file: ``stage/step/array``.

    An array carries ``units``, ``long_name`` and ``dims``, a status also ``flag_values`` and ``flag_meanings``; a group
    ``kind``, and the further attributes of its product as JSON text in the dataset ``attributes``.
    """
    with h5py.File(place(folder, f"{file_stem(name)}.h5"), "w", track_order=True) as file:
        file.attrs["program"] = f"dicflow {__version__}"
        for item in items:
            name = _group(item.stage)
            group = file[name] if name in file else file.create_group(name, track_order=True)
            _fill(group if item.step is None else group.create_group(_group(item.step), track_order=True), item.chosen)


def _group(name: str) -> str:
    """Name of one group: a slash would split it, and a dot alone means the group itself."""
    return name.replace("/", "_") if name.strip(".") else name.replace(".", "_")


def _fill(group: Any, product: Product) -> None:
    group.attrs["kind"] = product.kind
    group.create_dataset("attributes", data=json.dumps(dict(product.attrs), ensure_ascii=False))
    for name, variable in product.variables.items():
        packed = {"compression": "gzip", "compression_opts": 4} if variable.values.size else {}
        array = group.create_dataset(name, data=variable.values, **packed)
        array.attrs["units"] = variable.units
        array.attrs["long_name"] = variable.long_name or name
        array.attrs["dims"] = list(variable.dims)
        if name == STATUS_NAME:
            array.attrs.update(status_attributes())
