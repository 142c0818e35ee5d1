"""A run that fails has no cost."""

import numpy as np
import pytest
from PIL import Image

from tests import bench

pytestmark = pytest.mark.slow


def test_a_failed_run_ends_the_measurement_with_its_errors(tmp_path, monkeypatch):
    monkeypatch.setattr(bench, "WORK", tmp_path)
    Image.fromarray(np.zeros((64, 64), np.uint8)).save(tmp_path / "black.png")
    pipeline = tmp_path / "p.yaml"
    pipeline.write_text('stages: {photos: {stage: images, left: "*.png"}, found: {stage: region}}\n')
    with pytest.raises(SystemExit, match="found no speckled specimen"):
        bench.computed(tmp_path, tmp_path / "store", 1, pipeline)
