"""A file of a store that may not be read, also for root."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.replaced import replace_below

__all__ = ["deny"]


def deny(patched: pytest.MonkeyPatch, hidden: Path) -> None:
    """Let the store's reading of one file fail for want of permission."""

    def denied(path, *arguments, **options):
        raise PermissionError(13, "Permission denied", path)

    replace_below(patched, hidden, os, "open", denied)
