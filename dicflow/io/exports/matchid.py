"""CSV with the columns of MatchID's exports."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from dicflow.io.exports.items import Item, place
from dicflow.io.exports.points import points
from dicflow.io.results import columns_text
from dicflow.kinds.total import Total

__all__ = ["DESCRIPTION", "KINDS", "write"]

DESCRIPTION = "a table with MatchID's columns"
KINDS = ("total",)
_IN_PHOTOGRAPH = ("Coordinates.Image X [Pixel]", "Coordinates.Image Y [Pixel]")
_PLACES = ("coor.X [{unit}]", "coor.Y [{unit}]", "coor.Z [{unit}]")
_MOTIONS = (
    "disp.Horizontal Displacement U [{unit}]",
    "disp.Vertical Displacement V [{unit}]",
    "disp.Out-Of-Plane: W [{unit}]",
)
_STRAINS = {
    "exx": "strain.Strain-global frame: Exx [ ]",
    "eyy": "strain.Strain-global frame: Eyy [ ]",
    "exy": "strain.Strain-global frame: Exy [ ]",
    "e1": "strain.Strain-major: E1 [ ]",
    "e2": "strain.Strain-minor: E2 [ ]",
}


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """One table per step: places at the first step, displacement, strain; one row per measured point.

    Tables are compared by the places in the photograph, which exist if the points are the same material at every step.
    """
    for item in items:
        item.refuse_choice("matchid")
        found = points(item.product)
        names = [*(column.format(unit=found.unit) for column in (*_PLACES, *_MOTIONS)), *_STRAINS.values()]
        values = [found.xyz, found.displacement, *(found.strain[name] for name in _STRAINS)]
        if item.places is not None:
            names, values = [*_IN_PHOTOGRAPH, *names], [item.places()[Total.read(item.product).known()], *values]
        text = columns_text(names, np.column_stack(values))
        place(folder, f"{item.stem}.csv").write_text(text, encoding="utf-8")
