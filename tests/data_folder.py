"""Where the real photographs lie, which are not part of the repository."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["BESIDE", "SHARED", "shared"]

BESIDE = Path(__file__).resolve().parents[2] / "shared" / "data"


def shared() -> Path:
    """The folder that DICFLOW_DATA names, else the one beside the repository."""
    return Path(os.environ.get("DICFLOW_DATA") or BESIDE)


SHARED = shared()
