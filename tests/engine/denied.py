"""A file of a store that may not be read, also for root."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

__all__ = ["deny"]


def deny(patched: pytest.MonkeyPatch, hidden: Path) -> None:
    """Let the store's reading of one file fail for want of permission."""
    opened = os.open

    def denied(path, *arguments, **options):
        if os.fspath(path) == os.fspath(hidden):
            raise PermissionError(13, "Permission denied", path)
        return opened(path, *arguments, **options)

    patched.setattr("dicflow.engine.whole_file.os.open", denied)
