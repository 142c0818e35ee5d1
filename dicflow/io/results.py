"""Products as tables, and as files that other programs read: CSV and NPZ."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dicflow._version import __version__
from dicflow.engine.product import Product, Variable
from dicflow.errors import InputError
from dicflow.io.table import EXACT, TableStyle, note_line, row_text
from dicflow.kinds.kind import rows_of, steps_of, summary_of, titles_of
from dicflow.kinds.status import STATUS_NAME, status_legend

__all__ = ["ProductTable", "columns_text", "csv_text", "legends", "npz_bytes", "product_table", "table_text"]


class ProductTable(NamedTuple):
    """A product as a table.

    names : of the columns
    units : of those columns that have one; "1" for a number without unit
    rows : mappings of cells, or an array (row, column)
    """

    names: list[str]
    units: dict[str, str]
    rows: list[dict[str, object]] | np.ndarray


def product_table(product: Product, name: str) -> ProductTable:
    """One row per point of the product's grid.

    Arrays on the grid of the first two axes become one column each, a further axis one column per component.
    Products without arrays give their table of rows, or their summary. Arrays along the steps have the steps' names.

    Raises InputError if the product has neither.
    """
    if (rows := rows_of(product)) is not None or not product.variables:
        cells = [dict(row) for row in (rows if rows is not None else [_summary(product, name)])]
        return ProductTable(list(dict.fromkeys(key for row in cells for key in row)), {}, cells)
    grid = next(iter(product.variables.values())).dims[:2]
    columns = {
        label: (values, variable.units)
        for key, variable in product.variables.items()
        if variable.dims[: len(grid)] == grid
        for label, values in _columns(key, variable, len(grid))
    }
    units = {label: unit for label, (_, unit) in columns.items()}
    shape, steps = next(iter(columns.values()))[0].shape, steps_of(product)
    if grid == ("step",) and shape == (len(steps),):
        named = _rows(steps, {label: values for label, (values, _) in columns.items()})
        return ProductTable(["step", *columns], units, named)
    indices = {dim: index.ravel() for dim, index in zip(grid, np.indices(shape), strict=True)}
    table = np.column_stack([*indices.values(), *(values.ravel() for values, _ in columns.values())])
    return ProductTable([*indices, *columns], units, table)


def csv_text(product: Product, name: str, style: TableStyle = TableStyle()) -> str:  # noqa: B008  never changed
    """The table of a product as CSV; a commented header gives units and attributes. Raises as that does."""
    table, notes = product_table(product, name), _header(product, name)
    if product.variables and table.units:
        notes += _titles(product) + "".join(note_line(f"{label}: {unit}") for label, unit in table.units.items())
    if isinstance(table.rows, np.ndarray):
        return notes + columns_text(table.names, table.rows, style)
    return notes + table_text(table.rows, style)


def _rows(steps: Sequence[str], columns: Mapping[str, np.ndarray]) -> list[dict[str, object]]:
    """One row per step, with its name, of columns (step,)."""
    numbers = {label: [float(f"{value:.9g}") for value in values] for label, values in columns.items()}
    return [{"step": step, **{label: column[k] for label, column in numbers.items()}} for k, step in enumerate(steps)]


def columns_text(names: Sequence[str], table: np.ndarray, style: TableStyle = TableStyle(9)) -> str:  # noqa: B008
    """A table (row, column) as CSV below the names of its columns; nine digits bring single precision back."""
    buffer = io.StringIO()
    np.savetxt(buffer, table, fmt=f"%.{style.digits}g", delimiter=style.separator)
    return row_text(names, style) + buffer.getvalue().replace(".", style.decimal)


def table_text(rows: Sequence[Mapping[str, object]], style: TableStyle = EXACT) -> str:
    """Rows of equal keys as CSV; text that a spreadsheet would run as a formula has an apostrophe before it."""
    keys = list(dict.fromkeys(key for row in rows for key in row))
    return "".join([row_text(keys, style), *(row_text([row.get(key) for key in keys], style) for row in rows)])


def npz_bytes(product: Product) -> bytes:
    """All arrays under their names, and ``attributes`` as JSON text with the units of each."""
    units = {key: variable.units for key, variable in product.variables.items()}
    texts = {"kind": product.kind, "units": units, **product.attrs, **legends(product)}
    attributes = json.dumps(texts, ensure_ascii=False)
    buffer = io.BytesIO()
    arrays = {key: variable.values for key, variable in product.variables.items()}
    np.savez_compressed(buffer, attributes=np.array(attributes), **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def legends(product: Product) -> dict[str, str]:
    """``status_codes``: what the codes of a status mean; empty for a product without one."""
    return {"status_codes": status_legend()} if STATUS_NAME in product else {}


def _header(product: Product, name: str) -> str:
    notes = {key: value for key, value in product.attrs.items() if isinstance(value, str | int | float)}
    lines = [f"dicflow {__version__}", f"product: {name}", f"kind: {product.kind}"]
    texts = {**notes, **legends(product)}
    return "".join(map(note_line, [*lines, *(f"{key}: {value}" for key, value in texts.items())]))


def _titles(product: Product) -> str:
    """A title for each array; for strains it names the measure."""
    measures = titles_of(product)
    titles = {name: measures.get(name, variable.long_name) for name, variable in product.variables.items()}
    return "".join(note_line(f"{name} is {title}") for name, title in titles.items() if title)


def _summary(product: Product, name: str) -> Mapping[str, object]:
    summary = summary_of(product)
    if not summary:
        raise InputError(f"{name}: a product of kind {product.kind} has no values for a table; export it as npz")
    return summary


def _columns(key: str, variable: Variable, grid_axes: int) -> Iterator[tuple[str, np.ndarray]]:
    values = variable.values
    if values.ndim == grid_axes:
        yield key, values
        return
    flat = values.reshape(*values.shape[:grid_axes], -1)
    for index, label in enumerate(_component_labels(key, values.shape[grid_axes:])):
        yield label, flat[..., index]


def _component_labels(key: str, shape: tuple[int, ...]) -> list[str]:
    letters = {"xyz": "XYZ", "xyz_reference": "XYZ", "xy": "xy", "xy_reference": "xy", "points": "xy"}.get(key)
    if letters and shape == (len(letters),):
        stem = "reference_" if key.endswith("_reference") else ""
        return [f"{stem}{letter}" for letter in letters]
    return [f"{key}_{'_'.join(map(str, index))}" for index in np.ndindex(*shape)]
