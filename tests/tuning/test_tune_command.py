"""The command tune: what it refuses, prints and writes."""

from __future__ import annotations

import csv
import math
import shutil

import pytest
from PIL import Image
from small import ROOT, dicflow

from dicflow.pipeline import Pipeline
from tests.tuning.strained import PIPELINE, band, photographed

MEAN = 0.03 * 25.0 * math.sqrt(2.0 * math.pi) / 180.0
"""Strain of an extensometer of 180 px across the band."""
COMPARED = """\
  probes: {stage: probes, total: total, extensometers: {E: [[120, 30], [120, 210]]}}
  comparison: {stage: compare, caliper: caliper.csv, probes: probes, extensometer: E, total: total}
"""


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """A test that was tuned without wishes: its file, and the answer."""
    path = photographed(tmp_path_factory.mktemp("tuned"), band(0.03, 25.0)[0], 3.0)
    path.write_text(path.read_text() + COMPARED)
    rows = "".join(f"loading,0,{length:.2f}\n" for length in (100.0, 100.0, 100.0 * (1.0 + MEAN)))
    (path.parent / "caliper.csv").write_text(f"phase,load_g,length_mm\n{rows}")
    return path, dicflow("tune", path, "--workers", 1)


@pytest.fixture
def own(tuned, tmp_path):
    """A copy of the test's own, with the store."""
    shutil.copytree(tuned[0].parent, tmp_path / "test")
    return tmp_path / "test" / "pipeline.yaml"


def cells(path):
    with (path.parent / "results" / "pipeline" / "tune" / "settings.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def recommended(path):
    return next(row for row in cells(path) if "recommended" in row["mark"])


def noise(row):
    return max(float(row["predicted noise [µε]"]), float(row["measured noise [µε]"]))


def test_the_thesis_form_is_refused(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text((ROOT / "pipelines" / "thesis_quickstart.yaml").read_text())
    dicflow("tune", path).refuses(2, "p.yaml", "deformation", "correlate")


def test_a_sweep_in_the_file_is_refused(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(PIPELINE + "sweep:\n  grid: {total.window: [40, 50]}\n")
    dicflow("tune", path).refuses(2, "p.yaml", "sweep")


@pytest.mark.parametrize("option", [("--resolve", "3"), ("--noise", "much")])
def test_wishes_that_cannot_be_read(tmp_path, option):
    path = tmp_path / "p.yaml"
    path.write_text(PIPELINE)
    dicflow("tune", path, *option).refuses(2, option[0], "such as")


def test_one_camera_has_no_millimetres(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text(PIPELINE)
    dicflow("tune", path, "--resolve", "3 mm").refuses(2, "--resolve", "40 px")


@pytest.mark.slow
def test_it_says_what_it_does_and_recommends(tuned):
    _, answer = tuned
    assert answer.code == 0, answer.err
    assert "step_0 first, step_1 at rest, step_2 of largest strain" in answer.err
    count = int(next(line for line in answer.err.splitlines() if " settings, about " in line).split()[0])
    assert 30 < count < 200
    lines = answer.out.splitlines()
    assert any(line.startswith("present: subset 31 px, step 7 px, auto, window 49 px: VSG 73 px") for line in lines)
    assert any(line.startswith("recommended: ") for line in lines)
    assert "VSG [px]" in lines[0]
    (against,) = (line for line in lines if line.startswith("against the caliper, "))
    assert against.startswith(
        f"against the caliper, {100 * MEAN:.2f} % ± 141 µε at step_2 (extensometer E): present 1.05"
    )
    assert against.count("agrees") == 2


@pytest.mark.slow
def test_the_files_show_every_setting(tuned):
    path, _ = tuned
    rows = cells(path)
    assert sum("present" in row["mark"] for row in rows) == 1
    assert recommended(path)["mark"]
    for row in rows:
        side = float(row["window [px]"]) - float(row["step [px]"]) + float(row["subset [px]"])
        assert float(row["VSG [px]"]) == side
        assert float(row["measured noise [µε]"]) > 0.0
    picture = path.parent / "results" / "pipeline" / "tune" / "noise_over_resolution.png"
    with Image.open(picture) as image:
        assert min(image.size) > 400


@pytest.mark.slow
def test_apply_writes_the_file_with_its_comments_and_the_run_finds_products(own):
    answer = dicflow("tune", own, "--workers", 1, "--apply")
    assert answer.code == 0, answer.err
    row, text = recommended(own), own.read_text()
    assert text.startswith("# one camera\n")
    assert "# as init writes it" in text
    stages = Pipeline.load(own).document.data["stages"]
    assert stages["correlation"]["subset_size"] == int(row["subset [px]"])
    assert stages["correlation"]["step_size"] == int(row["step [px]"])
    assert stages["correlation"].get("shape_function", "auto") == row["subsets"]
    assert stages["total"]["window"] == f"{row['window [px]']} px"
    hits = {name: states["hit"] for name, states in Pipeline.load(own).plan().by_stage().items()}
    assert (hits["correlation"], hits["total"]) == (3, 0)  # the sweep had planes


@pytest.mark.slow
def test_wishes_are_met(own):
    assert dicflow("tune", own, "--workers", 1, "--resolve", "60 px").code == 0
    least = min(noise(row) for row in cells(own) if float(row["VSG [px]"]) <= 60.0)
    assert float(recommended(own)["VSG [px]"]) <= 60.0
    assert noise(recommended(own)) <= 1.03 * least


@pytest.mark.slow
def test_a_gauge_that_blurs_is_pointed_out_at_the_end(own):
    answer = dicflow("tune", own, "--workers", 1, "--noise", "90 µε")
    assert answer.code == 0, answer.err
    assert float(recommended(own)["bias [µε]"]) > 2.0 * noise(recommended(own))
    assert "blurs the strains" in answer.err.splitlines()[-1]


@pytest.mark.slow
def test_what_is_impossible_ends_with_what_is_possible(own):
    before = own.read_text()
    answer = dicflow("tune", own, "--workers", 1, "--resolve", "40 px", "--noise", "1 µε", "--apply")
    assert answer.code == 1
    assert "no setting has a noise of 1 µε" in answer.out
    assert own.read_text() == before
    assert not any("recommended" in row["mark"] for row in cells(own))
