"""How a process is prepared for work."""

import os
import subprocess
import sys

import pytest

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
