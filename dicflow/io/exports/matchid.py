"""CSV with the columns of MatchID's exports."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from dicflow.io.exports.items import Item, place
from dicflow.io.exports.points import points
from dicflow.io.results import columns_text

__all__ = ["KINDS", "write"]

KINDS = ("total",)
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
    """One table per step: place at the first step, displacement, strain; one row per measured point."""
    for item in items:
        item.refuse_choice("matchid")
        found = points(item.product)
        names = [*(column.format(unit=found.unit) for column in (*_PLACES, *_MOTIONS)), *_STRAINS.values()]
        strains = [found.strain[name] for name in _STRAINS]
        text = columns_text(names, np.column_stack([found.xyz, found.displacement, *strains]))
        place(folder, f"{item.stem}.csv").write_text(text, encoding="utf-8")
