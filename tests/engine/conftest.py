"""The engine's toy stages for all of its tests; worker processes inherit the path to them."""

import sys
from pathlib import Path

import psutil
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from dicflow.engine.references import cache
from dicflow.engine.store import Store


@pytest.fixture
def folder(tmp_path):
    """Six files, step_01 … step_06, that hold the numbers 1 … 6."""
    from toys import numbers

    return numbers(tmp_path / "numbers")


@pytest.fixture
def store(tmp_path):
    """An empty store."""
    return Store.open(tmp_path / "store")


@pytest.fixture
def ours():
    """A function that gives this process and those that it has started since the test began."""
    here = psutil.Process()
    earlier = set(here.children(recursive=True))
    return lambda: [here, *(set(here.children(recursive=True)) - earlier)]


@pytest.fixture(autouse=True)
def _no_products_in_memory():
    """Every test reads from its store, not from what another test has made."""
    cache.clear()
