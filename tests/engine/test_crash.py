import random
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import toys
from test_execute import index
from toys import chain, run_sync

from dicflow.engine.store import Store
from dicflow.engine.verification import verify

pytestmark = pytest.mark.slow

WRITER = """
import sys
from pathlib import Path
sys.path[:0] = sys.argv[3:]
import zarr, dask
from toys import chain, run_sync
from dicflow.engine.store import Store
print("ready", flush=True)
for factor in range(1, 1000):
    run_sync(chain(Path(sys.argv[1]), keep="always", factor=factor / 8), Store.open(Path(sys.argv[2])))
"""


def test_kill_9_at_random_points_with_two_writers(tmp_path):
    """Whatever a killed process leaves behind, nothing of it is ever taken for a result."""
    folder, store = toys.numbers(tmp_path / "numbers", 4), Store.open(tmp_path / "store")
    chance = random.Random(7)
    command = [sys.executable, "-c", WRITER, folder, store.path, str(Path(__file__).parent)]
    for _ in range(2):
        writers = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(2)]
        for writer in writers:
            assert writer.stdout.readline() == b"ready\n"
        for writer in writers:
            time.sleep(chance.uniform(0.2, 0.5))
            writer.kill()
        for writer in writers:
            writer.wait()
            writer.stdout.close()
    assert verify(store) == []
    records = list((store.path / "actions").rglob("*.json"))
    assert len(records) > 20
    for factor in (1 / 8, 2 / 8, 5 / 8):
        graph = chain(folder, keep="always", factor=factor)
        result = run_sync(graph, store)
        assert result.ok
        assert index(result) == index(run_sync(graph, Store.open(tmp_path / f"clean {factor}")))
        np.testing.assert_array_equal(result.product("total/step_04")["values"], 3 * factor)
