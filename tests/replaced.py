"""Functions of the whole process that a test replaces: other threads, such as those of libraries, keep the original."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

__all__ = ["replace_below", "replace_here"]

_Call = Callable[..., Any]


def replace_here(patch: pytest.MonkeyPatch, owner: Any, name: str, replacement: _Call) -> None:
    """Replace a function for the thread of the test."""
    here = threading.get_ident()
    _replace_where(patch, owner, name, replacement, lambda _: threading.get_ident() == here)


def replace_below(patch: pytest.MonkeyPatch, folder: Path, owner: Any, name: str, replacement: _Call) -> None:
    """Replace a function for paths in a folder, whichever thread asks."""
    _replace_where(patch, owner, name, replacement, lambda arguments: any(_is_below(one, folder) for one in arguments))


def _replace_where(
    patch: pytest.MonkeyPatch, owner: Any, name: str, replacement: _Call, is_meant: Callable[[tuple[Any, ...]], bool]
) -> None:
    original = getattr(owner, name)

    def chosen(*arguments: Any, **options: Any) -> Any:
        return (replacement if is_meant(arguments) else original)(*arguments, **options)

    patch.setattr(owner, name, chosen)


def _is_below(argument: Any, folder: Path) -> bool:
    return isinstance(argument, str | os.PathLike) and Path(argument).is_relative_to(folder)
