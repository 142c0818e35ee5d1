"""What several files of tests need and takes long to make: one process makes it, the others wait for it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.waiting import until

__all__ = ["copy_of_store", "made_once"]

_MOST_S = 600.0
"""Time that a busy machine may need to make one."""


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """A folder of all processes of this run of tests, which nobody changes. make : fills it; called in one process"""
    base = factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / name
    done, failed = folder.with_suffix(".done"), folder.with_suffix(".failed")
    try:
        folder.mkdir()
    except FileExistsError:
        until(lambda: done.exists() or failed.exists(), _MOST_S)
        assert done.exists(), f"{folder} could not be made; another test has the error"
        return folder
    try:
        make(folder)
    except BaseException:
        failed.touch()
        raise
    done.touch()
    return folder


def copy_of_store(store: Path, place: Path) -> Path:
    """A store with the products of another one, but without its runs."""
    return Path(shutil.copytree(store, place, ignore=shutil.ignore_patterns("runs")))
