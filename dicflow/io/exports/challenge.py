"""CSV with the 13 columns of the Stereo-DIC Challenge."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from dicflow.errors import ConfigurationError
from dicflow.io.exports.items import Item, place
from dicflow.io.exports.points import points
from dicflow.io.results import columns_text
from dicflow.kinds.total import Total

__all__ = ["DESCRIPTION", "KINDS", "write"]

DESCRIPTION = "the 13 columns of the Stereo-DIC Challenge"
KINDS = ("total",)
_STRAINS = ("exx", "eyy", "exy", "e1", "e2")
_COLUMNS = ("x_image", "y_image", "X", "Y", "Z", "U", "V", "W", *_STRAINS)


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """One table per step, one row per measured point, its places at the first step.

    Raises ConfigurationError if the points' places in the photograph of the first step are unknown.
    """
    for item in items:
        item.refuse_choice("challenge")
        if item.places is None:
            raise ConfigurationError(
                f"{item.stem}: its points are not the same material from step to step, so they have no place in the "
                "first photograph, which the challenge's columns need; export it as csv or matchid"
            )
        found = points(item.product)
        in_photograph = item.places()[Total.read(item.product).known()]
        strains = [found.strain[name] for name in _STRAINS]
        text = columns_text(_COLUMNS, np.column_stack([in_photograph, found.xyz, found.displacement, *strains]))
        place(folder, f"{item.stem}.csv").write_text(text, encoding="utf-8")
