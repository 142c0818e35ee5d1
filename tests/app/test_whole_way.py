"""From the photographs of two phones to the comparison with a caliper, without a file edited by hand."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from app_browser import opened_page
from app_serving import FILE, served

from dicflow.io.configuration import read
from dicflow.kinds.comparison import Comparison
from dicflow.kinds.probes import ProbeTable
from dicflow.pipeline import Pipeline
from tests.phones import taken_by_phones

pytestmark = pytest.mark.slow
ENDS = [(362, 134), (362, 455)]
"""Where the caliper touched the strip [px]."""


def test_a_student_compares_a_strip_with_the_caliper(tmp_path):
    """Names that do not agree, and a clock that is an hour ahead."""
    folder = taken_by_phones(tmp_path / "strip", steps=3, boards=8)
    with served(folder) as app, opened_page(app) as someone:
        page = someone.page
        page.wait_for_selector(".way")
        page.fill("#square", "14.5 mm")
        page.get_by_role("button", name="Make the pipeline file").click()
        page.wait_for_selector("section.region .viewer")
        page.click("text=Propose the region")
        someone.said("saved: the proposed region")
        someone.draw_extensometer(ENDS)
        someone.compare_lengths_of("extensometer_1")
        someone.go("run")
        page.get_by_role("button", name="Start", exact=True).click()
        page.wait_for_selector("h1.state.done")
        someone.go("explore")
        someone.until("document.querySelector('.fields')?.explorer.firstDrawn > 0")
        assert "Is the rig still calibrated? Yes" in page.inner_text(".x-rig")
        assert set(page.locator(".x-probe-name").all_text_contents()) == {"along_load", "extensometer_1"}
        someone.go("calibration")
        page.wait_for_selector(".pairs-table")
        assert "8 of 8 pairs" in page.inner_text(".verdict")
        assert page.inner_text(".answer").startswith("Is the rig still calibrated? Yes, the rig is still calibrated")
        someone.go("caliper")
        page.wait_for_selector(".x-chart polyline")
        shown = app.found("caliper", file=FILE)["rows"]
    drawn = read(folder / FILE).data["stages"]["probes"]["extensometers"]["extensometer_1"]
    assert np.abs(np.array(drawn) - ENDS).max() < 1.0
    result = Pipeline.load(folder / FILE).result()
    rows = [row for row in ProbeTable.read(result.product("probes")).rows if row["probe"] == "extensometer_1"]
    with (folder / "results/pipeline/probes.csv").open() as file:
        lines = [line for line in file if not line.startswith("#")]
    written = [row for row in csv.DictReader(lines) if row["probe"] == "extensometer_1"]
    assert [float(row["strain"]) for row in written] == pytest.approx([row["strain"] for row in rows], rel=1e-4)
    errors = [row["strain_error"] for row in Comparison.read(result.product("compare")).rows]
    assert [row["strain_error"] for row in shown] == errors
    assert len(errors) == 3
    assert np.abs(errors).max() < 2e-3
    assert rows[-1]["strain"] > 0.3
