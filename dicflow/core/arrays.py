"""The types of arrays, named once; what an array's axes are is said where it is used."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Codes", "Grey", "Image", "Index", "Mask"]

Array = NDArray[np.float64]
"""Numbers in double precision."""
Image = NDArray[np.float32]
"""Grey levels as numbers to compute with."""
Grey = NDArray[Any]
"""Grey levels as a file holds them: uint8 or uint16."""
Mask = NDArray[np.bool_]
"""Whether, for each element."""
Codes = NDArray[np.uint8]
"""Codes of an enumeration, such as a status."""
Index = NDArray[np.int64]
"""Places along the axes of another array."""
