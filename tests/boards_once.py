"""Which board a photograph shows takes long to find; tests that use the same photographs find it once."""

from __future__ import annotations

from hashlib import sha256

import numpy as np
import pytest

from dicflow.core.arrays import Grey
from dicflow.core.calibration.board import Board
from dicflow.start import folder

__all__ = ["recognise_boards_once"]

_found: dict[tuple[object, ...], Board | None] = {}
"""By shape, type and digest of the photograph, and how thoroughly it was searched."""


def recognise_boards_once(patch: pytest.MonkeyPatch) -> None:
    """Let ``init`` and the app remember, for all tests of this process, the boards of photographs."""
    original = folder.identify_board

    def identify(image: Grey, thorough: bool = True) -> Board | None:
        key = image.shape, image.dtype.str, sha256(np.ascontiguousarray(image)).hexdigest(), thorough
        if key not in _found:
            _found[key] = original(image, thorough)
        return _found[key]

    patch.setattr(folder, "identify_board", identify)
