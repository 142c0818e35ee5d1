"""Tables and coordinates of a measurement that has loads and times."""

from __future__ import annotations

import shutil

import cv2
import numpy as np
import pytest

import dicflow
from dicflow.core.synthetic.planar import planar_pair

pytestmark = pytest.mark.slow

LOADS_N = (0.0, 1.5, 3.0)
TIMES_S = (0.0, 2.0, 4.5)
PROBES = """\
  machine: {stage: channels, images: photos, file: machine.csv, join: order}
  probes: {stage: probes, extensometers: {length: [[50, 50], [50, 130]]}}
"""


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("loads")
    pair = planar_pair((200, 180), np.diag([1.0, 1.01, 1.0]), seed=5)
    dicflow.measure(
        [pair.reference, pair.reference, pair.deformed],
        region=[[[40, 40], [160, 40], [160, 140], [40, 140]]],
        folder=folder,
    )
    rows = [f"{time},{load}" for time, load in zip(TIMES_S, LOADS_N, strict=True)]
    (folder / "machine.csv").write_text("\n".join(["time [s],force [N]", *rows]) + "\n")
    with (folder / "pipeline.yaml").open("a") as file:
        file.write(PROBES)
    yield dicflow.Pipeline.load(folder / "pipeline.yaml").run(scheduler="sync")
    shutil.rmtree(folder)


def test_the_table_of_the_probes_is_a_dataframe(result):
    table = result.to_dataframe("probes")
    assert table["step"].tolist() == ["reference", "step_0001", "step_0002"]
    assert table["strain"].iloc[-1] == pytest.approx(0.01, abs=5e-4)
    assert table["force_N"].tolist() == list(LOADS_N)


def test_steps_have_time_and_load(result):
    whole = result.dataset("total", chunks="auto")
    assert whole.time.values.tolist() == list(TIMES_S[1:])
    assert whole["load"].values.tolist() == list(LOADS_N[1:])
    assert (whole.time.attrs["units"], whole["load"].attrs["units"]) == ("s", "N")
    alone = result.dataset("total", -1)
    assert (float(alone.time), float(alone["load"])) == (TIMES_S[-1], LOADS_N[-1])


def test_photographs_have_the_time_of_their_names(tmp_path):
    for second in (0, 2, 7):
        cv2.imwrite(str(tmp_path / f"test_{second}.png"), np.full((32, 32), 90 + second, np.uint8))
    file = tmp_path / "pipeline.yaml"
    file.write_text('dicflow: 1\nstages: {photos: {stage: images, left: "*.png", time: name}}\n')
    result = dicflow.Pipeline.load(file).run(scheduler="sync")
    times = result.dataset("photos", chunks="auto").time
    assert times.values.tolist() == [0.0, 2.0, 7.0]
    assert float(result.dataset("photos", 1).time) == result.attributes("photos", 1)["time"] == 2.0
