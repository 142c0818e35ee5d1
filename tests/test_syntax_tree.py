"""Syntax trees for several threads at once."""

import gc
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import dicflow
from dicflow.discovery import syntax_tree

SOURCES = [path.read_bytes() for path in sorted(Path(dicflow.__file__).parent.rglob("*.py"))[:100]]


@pytest.fixture
def often_interrupted():
    """Threads take turns, also while a tree is made, as garbage is collected then."""
    interval, threshold = sys.getswitchinterval(), gc.get_threshold()

    def turn(_phase, _facts):
        for _ in range(200):
            pass

    sys.setswitchinterval(1e-6)
    gc.set_threshold(50)
    gc.callbacks.append(turn)
    yield
    gc.callbacks.remove(turn)
    gc.set_threshold(*threshold)
    sys.setswitchinterval(interval)


def test_threads_make_trees_at_the_same_time(often_interrupted):
    def bodies(_thread):
        return [len(syntax_tree(source, "source").body) for source in SOURCES]

    with ThreadPoolExecutor(3) as threads:
        one, *others = threads.map(bodies, range(3))
    assert min(one[1:]) >= 1
    assert others == [one, one]
