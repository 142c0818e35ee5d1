"""Photographs that show nothing, in the thesis's form through the command line: each costs only its own step."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from small import dicflow

from dicflow.pipeline import Pipeline

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[1]
PIPELINE = ROOT / "pipelines" / "thesis_quickstart.yaml"
STEPS = 8
SPOILT = [
    ({("left", 3): 0, ("right", 3): 0}, {3}),
    ({("left", 7): 255, ("right", 7): 255}, {7}),
    ({("left", 4): 0, ("left", 5): 255}, {4, 5}),
    ({("right", 3): 0}, {3}),
    ({("left", 1): 0, ("right", 5): 255}, {1, 5}),
]
NAMES = ["a middle step", "the last step", "two neighbours", "the right camera", "the first pair and a camera"]


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """One store for all, so that boards and good photographs are measured once."""
    return tmp_path_factory.mktemp("store")


@pytest.mark.parametrize(("spoilt", "lost"), SPOILT, ids=NAMES)
def test_a_photograph_that_shows_nothing_costs_only_its_step(store, tmp_path, spoilt, lost):
    data = tmp_path / "data"
    shutil.copytree(ROOT / "data_samples", data)
    for (side, step), grey in spoilt.items():
        path = data / "photos" / side / f"step_{step:02d}.png"
        Image.fromarray(np.full_like(np.asarray(Image.open(path)), grey)).save(path)
    given = (PIPELINE, "--data", data, "--store", store, "--output", tmp_path / "out", "--scheduler", "sync")
    answer = dicflow("run", *given, "--workers", 1, "--json")
    assert answer.code == 0, answer.err
    assert answer.line["counts"]["failed"] == 0
    said = [text for text in answer.line["warnings"] if "no texture in this" in text]
    for step in lost:
        assert any(f"step_{step:02d}" in text for text in said)
    assert all(text in answer.err for text in said)
    assert "no texture in this" in (tmp_path / "out" / "report.html").read_text()

    result = Pipeline.load(PIPELINE, data=data, store=store).result()
    strain, truth = (np.array(result.product("comparison")[name]) for name in ("dic_strain", "caliper_strain"))
    assert set(np.flatnonzero(np.isnan(strain))) == lost
    known = np.isfinite(strain) & (truth > 0)
    assert np.abs(strain[known] / truth[known] - 1.0).max() < 5e-3
    for step in range(1, STEPS):
        total = result.dataset("total", step=step - 1)
        assert bool(np.isnan(total.eyy).all()) == (step in lost)
        if step not in lost:
            assert float(abs(total.eyy.mean() / truth[step] - 1.0)) < 1e-2
            assert int((total.status <= 1).sum()) > 0.9 * int((result.dataset("track", step=0).status == 0).sum())
