"""Products as files that other programs read, one module per format.

A module of this package that carries a format's name has

- ``KINDS``: the kinds of products that the format can hold, None for any;
- ``write(items, folder, name)``: writes products into a folder of their own, one after the other.
"""

from __future__ import annotations

import importlib
from types import ModuleType

__all__ = ["FORMATS", "format_module"]

FORMATS = {
    "csv": "a table with units",
    "matchid": "a table with MatchID's columns",
    "challenge": "the 13 columns of the Stereo-DIC Challenge",
    "hdf5": "one file for all",
    "mat": "MATLAB",
    "npz": "NumPy",
    "vtu": "ParaView, with a PVD that plays the steps",
    "geojson": "a region",
    "json": "a rig",
    "opencv": "a rig as OpenCV's YAML",
}
"""What each format is, by its name."""


def format_module(name: str) -> ModuleType:
    """The module that writes a format, one of ``FORMATS``."""
    return importlib.import_module(f"dicflow.io.exports.{name}")
