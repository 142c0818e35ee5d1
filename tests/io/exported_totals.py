"""Totals with exact fields, a hole and a point without a neighbour, as the forms of measurement give them."""

from __future__ import annotations

import numpy as np

from dicflow.engine.product import Product, Variable
from dicflow.io.exports.items import Item

ROWS, COLS = 7, 5
FORMS = ("thesis", "precise", "planar")
GRID = ("row", "col")


def total(form="precise", step=1):
    """A total of one step: linear fields that single precision does not hold exactly, NaN where nothing is known."""
    row, col = np.indices((ROWS, COLS)).astype(float)
    unit = "px" if form == "planar" else "mm"
    fields = {
        "U": step * 0.1 * col / 3.0,
        "V": step * 0.2 * row / 7.0,
        "W": 0.0 * row if form == "planar" else step * 1e-6 * (row + col) / 3.0,
        "exx": step * (0.01 + 1e-5 * row),
        "eyy": step * (-0.003 + 1e-6 * col),
        "gxy": step * 1e-4 * (row - col),
    }
    if form == "precise":
        fields |= {"e1": 2.0 * fields["exx"], "e2": 3.0 * fields["eyy"], "sigma_exx": (1e-5 + 0.0 * row)}
    places = np.stack([300.0 + 7.0 * col, 200.0 + 7.0 * row], axis=-1)
    xyz = np.stack([col / 3.0, row / 3.0, 0.0 * row if form == "planar" else 400.0 + col / 9.0], axis=-1)
    arrays = {name: (GRID, values, "mm" if name in "UVW" else "1") for name, values in fields.items()}
    arrays["xyz"] = ((*GRID, "component"), xyz + np.stack([fields[name] for name in "UVW"], axis=-1), unit)
    arrays["xyz_reference"] = ((*GRID, "component"), xyz, unit)
    arrays["xy"] = ((*GRID, "image_component"), places + step, "px")
    if form == "precise":
        arrays["xy_reference"] = ((*GRID, "image_component"), places, "px")
        arrays["covariance"] = ((*GRID, "pair"), np.ones((ROWS, COLS, 6), np.float32) / 3.0, "mm²")
    lost = hole()
    variables = {name: Variable(dims, _without(values, lost), units) for name, (dims, values, units) in arrays.items()}
    variables["status"] = Variable(GRID, np.where(lost, 10, 0).astype(np.uint8), "1", "why a point has no value")
    return Product("total", variables, _attributes(form, unit))


def hole():
    """(row, col) bool — what is lost: a corner's neighbours, so that it stands alone, and one point in the middle."""
    lost = np.zeros((ROWS, COLS), bool)
    lost[0, 1] = lost[1, 0] = lost[1, 1] = lost[4, 3] = True
    return lost


def known(product, name):
    """Values of the points that are not lost, row by row."""
    return product[name][~hole()]


def item(form="precise", step=1):
    """A total with its names."""
    named = Item("total", f"step_{step:02d}", total(form, step), number=step)
    return named._replace(places=lambda: total("precise", step)["xy_reference"])


def same(found, wanted):
    """Check that numbers agree to single precision, NaN included."""
    np.testing.assert_array_equal(np.asarray(found, np.float32), np.asarray(wanted, np.float32))


def _without(values, lost):
    values = values.copy()
    values[lost] = np.nan
    return values


def _attributes(form, unit):
    gauge = {"vsg_px": 63.0, "vsg_mm": 3.1 if unit == "mm" else None} if form != "thesis" else {}
    return {
        "definition": "material" if form == "thesis" else "precise",
        "unit": unit,
        "step_size": 7,
        "measures": {"exx": "engineering strain εxx", "U": "displacement along x"},
        **gauge,
        "summary": {"mean_exx": 0.01},
    }
