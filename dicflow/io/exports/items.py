"""What is exported: a product with its names, and its place in the test."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from dicflow.engine.product import Product
from dicflow.errors import ConfigurationError, InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["Item", "place"]

_REFUSED = re.compile(r'[\x00-\x1f<>:"/\\|?*]')
"""Characters that some file system does not allow in a name."""


class Item(NamedTuple):
    """A product to be written.

    stage, step : its names; step is None for a stage that runs once
    product : with all its arrays
    quantities : names of the arrays to write; empty for all
    places : gives the place of every point in the left photograph of the first step, (row, col, 2) [px]; None if
        unknown
    outline : carries pixels of the image in which a region is kept, (n, 2), into those of the left photograph
    number : of the step in the test; the first photograph has 0
    """

    stage: str
    step: str | None
    product: Product
    quantities: tuple[str, ...] = ()
    places: Callable[[], NDArray[Any]] | None = None
    outline: Callable[[NDArray[Any]], NDArray[Any]] | None = None
    number: int = 0

    @property
    def stem(self) -> str:
        """Name of its file without the suffix; characters that some file system does not allow are underscores."""
        return _REFUSED.sub("_", self.stage if self.step is None else f"{self.stage}_{self.step}")

    @property
    def chosen(self) -> Product:
        """The product with the selected arrays."""
        if not self.quantities:
            return self.product
        arrays = {name: self.product.variables[name] for name in self.quantities}
        return Product(self.product.kind, arrays, self.product.attrs)

    def refuse_choice(self, format_name: str) -> None:
        """Raise ConfigurationError if arrays are selected, for a format whose columns are fixed."""
        if self.quantities:
            raise ConfigurationError(f"{format_name} has fixed columns; leave --quantity out, or export as csv")


def place(folder: Path, name: str) -> Path:
    """Path of a file to be written. Raises InputError if two products have the same file name."""
    path = folder / name
    if path.exists():
        raise InputError(f"{name}: two products have this file name; export each into a folder of its own")
    return path
