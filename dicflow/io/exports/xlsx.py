"""A workbook of Excel's format, which other spreadsheets read too: one sheet per table."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dicflow.core.status import Status
from dicflow.engine.product import Product
from dicflow.errors import ConfigurationError, InputError
from dicflow.io.exports.items import Item, file_stem, place
from dicflow.io.results import ProductTable, product_table
from dicflow.io.table import EXACT
from dicflow.kinds.kind import summary_of
from dicflow.kinds.quantities import of_field
from dicflow.kinds.status import STATUS_NAME

__all__ = ["DESCRIPTION", "KINDS", "ONE_STEP", "write"]

DESCRIPTION = "a workbook with one sheet per table (needs dicflow[xlsx])"
KINDS = ("total", "probes", "comparison", "channels", "noise")
ONE_STEP = True
_MOST_ROWS = 1_048_576
_LONGEST_NAME = 31
_PLACES = ("xy_reference", "xyz_reference", "xy", "xyz")
_REFUSED = re.compile(r"[\[\]:*?/\\]|^'|'$")
"""What the name of a sheet must not have."""
_UNPRINTABLE = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]")


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """One workbook: a summary with one row per step of totals, then a sheet per product, with units in its header.

    Of the points of a total, if no arrays are selected, it has places, quantities, their uncertainty and status;
    covariances, gradients and parts of the uncertainty are for programs.

    Raises ConfigurationError where openpyxl is not installed, InputError for a table with more rows than a sheet has.
    """
    try:
        from openpyxl import Workbook
    except ImportError as error:
        raise ConfigurationError("the format xlsx needs openpyxl: pip install 'dicflow[xlsx]'") from error
    book = Workbook(write_only=True)
    overview, summaries, titles = book.create_sheet("summary"), [], {"summary"}
    for item in items:
        if item.product.kind == "total":
            summaries.append({"stage": item.stage, "step": item.step, **summary_of(item.product)})
        if item.whole:
            table = product_table(item.placed if item.quantities else _readable(item.placed), item.stem)
            table = _in_region(table)
            _check_rows(item, table)
            _fill(book.create_sheet(_title(item.stem, titles)), table, item.style.digits)
    if summaries:
        names = list(dict.fromkeys(key for row in summaries for key in row))
        _fill(overview, ProductTable(names, {}, summaries), EXACT.digits)
    else:
        book.remove(overview)
    book.save(place(folder, f"{file_stem(name)}.xlsx"))


def _readable(product: Product) -> Product:
    """A total without the arrays that people do not read."""
    if product.kind != "total":
        return product
    arrays = {name: array for name, array in product.variables.items() if _is_readable(name, product)}
    return Product(product.kind, arrays, product.attrs)


def _is_readable(name: str, product: Product) -> bool:
    if name in (*_PLACES, STATUS_NAME):
        return True
    quantity = of_field(name)
    if quantity is None:
        return False
    return name in (quantity.name, f"u_{quantity.name}") or (
        name == f"sigma_{quantity.name}" and f"u_{quantity.name}" not in product
    )


def _in_region(table: ProductTable) -> ProductTable:
    """The table without the points of the grid that lie outside the region."""
    if not isinstance(table.rows, np.ndarray) or STATUS_NAME not in table.names:
        return table
    return table._replace(rows=table.rows[table.rows[:, table.names.index(STATUS_NAME)] != Status.OUTSIDE])


def _check_rows(item: Item, table: ProductTable) -> None:
    if len(table.rows) >= _MOST_ROWS:
        problem = f"has {len(table.rows):,} points, a sheet {_MOST_ROWS:,} rows"
        raise InputError(item.stem, problem, "export it as csv, npz or hdf5, or measure with a larger step size")


def _title(stem: str, taken: set[str]) -> str:
    """A name for a sheet that no other has, in upper or lower case. taken : takes it"""
    stem = _UNPRINTABLE.sub("_", _REFUSED.sub("_", stem))
    endings = ("" if number == 1 else f" ({number})" for number in range(1, len(taken) + 2))
    titles = (stem[: _LONGEST_NAME - len(ending)] + ending for ending in endings)
    title = next(title for title in titles if title.lower() not in taken)
    taken.add(title.lower())
    return title


def _fill(sheet: Any, table: ProductTable, digits: int) -> None:
    """Header, which stays in view, and rows. digits : significant ones of the numbers of points"""
    sheet.freeze_panes = "A2"
    header = (
        f"{name} [{unit}]" if (unit := table.units.get(name, "1")) not in ("", "1") else name for name in table.names
    )
    sheet.append([_cell(sheet, text) for text in header])
    for row in _values(table, digits):
        sheet.append([_cell(sheet, value) for value in row])


def _values(table: ProductTable, digits: int) -> Iterator[Sequence[Any]]:
    if isinstance(table.rows, np.ndarray):
        for row in table.rows.tolist():
            yield row if digits >= EXACT.digits else [float(f"{value:.{digits}g}") for value in row]
    else:
        for cells in table.rows:
            yield [cells.get(name) for name in table.names]


def _cell(sheet: Any, value: object) -> Any:
    """A number; nothing for an unknown one; or text, which is never a formula."""
    from openpyxl.cell import WriteOnlyCell

    if value is None or isinstance(value, bool | int | float):
        return value if not isinstance(value, float) or math.isfinite(value) else None
    cell = WriteOnlyCell(sheet, _UNPRINTABLE.sub("_", str(value)))
    cell.data_type = "s"
    return cell
