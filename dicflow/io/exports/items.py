"""What is exported: a product, with its names and what only the whole test knows of it."""

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
"""Characters that a file system does not take in a name."""


class Item(NamedTuple):
    """A product to be written.

    stage, step : its names; no step for a stage that runs once
    product : whole
    quantities : names of the arrays to write; all without any
    places : gives the place of every point in the left photograph of the first step, (row, col, 2) [px]; None where
        there is none
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
        """Name of its file without the suffix; characters that no file system takes are underscores."""
        return _REFUSED.sub("_", self.stage if self.step is None else f"{self.stage}_{self.step}")

    @property
    def chosen(self) -> Product:
        """The product with the arrays that are asked for."""
        if not self.quantities:
            return self.product
        arrays = {name: self.product.variables[name] for name in self.quantities}
        return Product(self.product.kind, arrays, self.product.attrs)

    def refuse_choice(self, format_name: str) -> None:
        """Raise ConfigurationError where arrays are chosen, for a format whose columns are fixed."""
        if self.quantities:
            raise ConfigurationError(f"{format_name} has columns of its own; leave --quantity out, or export as csv")


def place(folder: Path, name: str) -> Path:
    """Path of a file that is not there yet. Raises InputError where two products would share a file."""
    path = folder / name
    if path.exists():
        raise InputError(f"{name}: two products would have this file; export them one by one into two folders")
    return path
