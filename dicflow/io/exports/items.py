"""What is exported: a product with its names, and its place in the test."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from dicflow.engine.product import Product, Variable
from dicflow.errors import ConfigurationError, InputError
from dicflow.io.table import TableStyle
from dicflow.io.text import printable

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["Item", "file_stem", "place"]

_REFUSED = re.compile(r'[\x00-\x1f\x7f-\x9f<>:"/\\|?*]|^[ .-]|[ .]$')
"""Characters that some file system does not allow in a name, or that hide it or make it an option."""
_WORD = re.compile(r"\w[\w.-]*")
_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³]|conin\$|conout\$) *(\.|$)", re.IGNORECASE)
"""Names that Windows keeps for devices, with any suffix."""


_PLACES = ("xy_reference", "xyz_reference")
"""Places at the first step, in the left photograph [px] and in space, beside selected arrays of a total."""


class Item(NamedTuple):
    """A product to be written.

    stage, step : its names; step is None for a stage that runs once
    product : with all its arrays
    quantities : names of the arrays to write; empty for all
    places : gives the place of every point in the left photograph of the first step, (row, col, 2) [px]; None if
        unknown
    outline : carries pixels of the image in which a region is kept, (n, 2), into those of the left photograph
    number : of the step in the test; the first photograph has 0
    whole : whether all points are written; otherwise the summary alone, by a format with ``ONE_STEP``
    style : of the numbers in tables for people
    """

    stage: str
    step: str | None
    product: Product
    quantities: tuple[str, ...] = ()
    places: Callable[[], NDArray[Any]] | None = None
    outline: Callable[[NDArray[Any]], NDArray[Any]] | None = None
    number: int = 0
    whole: bool = True
    style: TableStyle = TableStyle()

    @property
    def stem(self) -> str:
        """Name of its file without the suffix."""
        return file_stem(self.stage if self.step is None else f"{self.stage}_{self.step}")

    @property
    def chosen(self) -> Product:
        """The product with the selected arrays; of a total also the places at the first step.

        Raises InputError for an array whose name is not a word.
        """
        for name in self.product.variables:
            if not _WORD.fullmatch(name):
                problem = f"has an array '{printable(name)}', expected a word of letters and digits"
                raise InputError(self.stem, problem, "do not use this store, or fix the plug-in that gave the name")
        product = self.product
        if not self.quantities:
            return product
        places = [name for name in _PLACES if product.kind == "total" and name in product]
        arrays = {name: product.variables[name] for name in (*places, *self.quantities)}
        return Product(product.kind, arrays, product.attrs)

    def refuse_choice(self, format_name: str) -> None:
        """Raise ConfigurationError if arrays are selected, for a format whose columns are fixed."""
        if self.quantities:
            raise ConfigurationError(f"{format_name} has fixed columns; leave --quantity out, or export as csv")

    @property
    def placed(self) -> Product:
        """The selected arrays; of a total also the places in the first photograph, which comparisons need."""
        product = self.chosen
        if self.places is None or "xy_reference" in product:
            return product
        places = Variable(
            ("row", "col", "component"), self.places(), "px", "place in the left photograph of the first step"
        )
        return Product(product.kind, {**product.variables, "xy_reference": places}, product.attrs)


def file_stem(name: str) -> str:
    """A name of a file without suffix that every file system allows, with underscores where need be."""
    stem = _REFUSED.sub("_", name)
    return f"{stem}_" if _DEVICE.match(stem) else stem


def place(folder: Path, name: str) -> Path:
    """Path of a file to be written. Raises InputError if it is not one in the folder, or two products have its name."""
    if _REFUSED.search(name):
        raise InputError(printable(name), "is not the name of a file", "do not use this store, or rename the quantity")
    path = folder / name
    if path.exists():
        raise InputError(name, "two products have this file name", "export each into a folder of its own")
    return path
