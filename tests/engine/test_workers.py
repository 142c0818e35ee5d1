"""How a process is prepared for work."""

import os
import subprocess
import sys

import pytest

from dicflow.engine.workers import with_room

pytestmark = pytest.mark.slow

LOADED_BEFORE = """
import numba
from dicflow.engine.workers import prepare
prepare()
print(numba.njit(lambda x: x + 1)(1), numba.get_num_threads())
"""


def test_a_worker_that_has_loaded_numba_can_still_compile():
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA")}
    command = [sys.executable, "-c", LOADED_BEFORE]
    assert subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout == "2 1\n"


def test_calls_with_room_ask_the_system_for_no_memory_at_any_depth():
    """Where frames lie in pieces of 16 KB, calls that cross a border cost a page each time."""
    resource = pytest.importorskip("resource")

    def faults(level):
        """Most page faults of 2000 calls, at this depth and all depths below."""
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        for _ in range(2000):
            abs_of(-1)
        here = resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
        return max(here, faults(level - 1)) if level else here

    def abs_of(value):
        return abs(value)

    assert with_room(lambda: faults(400)) < 1000
    with pytest.raises(ZeroDivisionError):
        with_room(lambda: 1 / 0)
