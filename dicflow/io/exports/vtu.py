"""VTK's unstructured grids: one VTU per step, and a PVD that lists them in order for ParaView."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import meshio
import numpy as np

from dicflow.engine.product import Product
from dicflow.io.exports.items import Item, place
from dicflow.io.exports.points import in_space, quads
from dicflow.kinds.total import Total

__all__ = ["DESCRIPTION", "KINDS", "write"]

DESCRIPTION = "ParaView, with a PVD that plays the steps"
KINDS = ("total",)


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """The measured points at the first step, their cells, and on every point ``displacement`` and the total's fields.

    Lengths are in the unit of the total; a point without a neighbour is a cell of its own. The time of a step is its
    number in the test, which for the first photograph is 0.
    """
    series: dict[str, dict[int, str]] = {}
    for item in items:
        path = place(folder, f"{item.stem}.vtu")
        meshio.vtu.write(path, _mesh(item), binary=True, compression="zlib")
        series.setdefault(item._replace(step=None).stem, {})[item.number] = path.name
    for stem, names in series.items():
        place(folder, f"{stem}.pvd").write_bytes(_pvd(names))


def _mesh(item: Item) -> Any:
    total = item.product
    known = Total.read(total).known()
    cells = quads(known)
    alone = np.setdiff1d(np.arange(known.sum()), cells)
    data = {name: np.ascontiguousarray(values[known]) for name, values in _fields(item.chosen).items()}
    data["displacement"] = np.stack([total[name][known] for name in "UVW"], axis=-1)
    blocks = [("quad", cells), ("vertex", alone[:, None])]
    return meshio.Mesh(in_space(total["xyz_reference"][known]), [block for block in blocks if len(block[1])], data)


def _fields(product: Product) -> dict[str, Any]:
    """The arrays with one number per point."""
    grid = ("row", "col")
    return {name: variable.values for name, variable in product.variables.items() if variable.dims == grid}


def _pvd(names: Mapping[int, str]) -> bytes:
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ElementTree.SubElement(root, "Collection")
    for time, name in names.items():
        ElementTree.SubElement(collection, "DataSet", timestep=str(time), part="0", file=name)
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"
