"""From a folder of photographs to the map and the probe's curve, without a file edited by hand."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest
from app_browser import opened_page
from app_serving import FILE, served

from dicflow.io.configuration import read
from dicflow.kinds.probes import ProbeTable
from dicflow.pipeline import Pipeline

pytestmark = pytest.mark.slow
SAMPLES = Path(__file__).resolve().parents[2] / "data_samples"
ENDS = [(350, 160), (352, 430)]


def test_a_student_measures_a_strip(tmp_path):
    folder = tmp_path / "strip"
    for name in ("photos", "boards"):
        shutil.copytree(SAMPLES / name, folder / name)
    for step in range(3, 8):
        for side in ("left", "right"):
            (folder / "photos" / side / f"step_{step:02}.png").unlink()
    with served(folder) as app, opened_page(app) as someone:
        page = someone.page
        page.set_default_timeout(180_000)
        page.wait_for_selector(".series select")
        page.fill("#square", "14.5 mm")
        page.get_by_role("button", name="Make the pipeline file").click()
        page.wait_for_selector("section.region .viewer")
        page.wait_for_timeout(500)
        page.focus(".viewer")
        page.keyboard.press("e")
        for place in ENDS:
            someone.click(place)
        someone.said("saved: extensometer_1")
        someone.go("run")
        page.get_by_role("button", name="Start", exact=True).click()
        page.wait_for_selector("h1.state.done")
        someone.go("explore")
        someone.until("document.querySelector('.fields')?.explorer.firstDrawn > 0")
        someone.go("calibration")
        page.wait_for_selector(".pairs-table")
        assert "12 of 12 pairs" in page.inner_text(".verdict")
    drawn = read(folder / FILE).data["stages"]["probes"]["extensometers"]["extensometer_1"]
    assert np.abs(np.array(drawn) - ENDS).max() < 1.0
    product = Pipeline.load(folder / FILE).result().product("probes")
    rows = [row for row in ProbeTable.read(product).rows if row["probe"] == "extensometer_1"]
    with (folder / "results/pipeline/probes.csv").open() as file:
        lines = [line for line in file if not line.startswith("#")]
    written = [row for row in csv.DictReader(lines) if row["probe"] == "extensometer_1"]
    assert len(rows) == len(written) == 3
    strain = [float(next(value for name, value in row.items() if name.startswith("strain"))) for row in written]
    expected = [float(next(value for name, value in row.items() if name.startswith("strain"))) for row in rows]
    assert strain == pytest.approx(expected, rel=1e-4)
    assert strain[-1] > 0.1
