"""From photographs to a report and a table in four commands."""

import csv
import shutil

import numpy as np
import pytest
from small import dicflow

from tests.pages import Page

pytestmark = pytest.mark.slow


@pytest.fixture
def photographs(pipeline, tmp_path):
    """Photographs of specimen and boards, and a caliper's table; nothing that dicflow has written."""
    left_out = shutil.ignore_patterns("*.yaml", "truth", ".dicflow", "results", "*.geojson")
    return shutil.copytree(pipeline.parent, tmp_path / "my test", ignore=left_out)


def test_four_commands(photographs, tmp_path):
    file, store, results = photographs / "pipeline.yaml", tmp_path / "store", tmp_path / "results"
    for command in (
        ("init", photographs, "--square", "14.5 mm"),
        ("run", file, "--store", store, "--output", results, "--scheduler", "sync"),
        ("report", file, "--store", store, "--output", results),
        ("export", file, "--store", store, "--output", tmp_path / "tables"),
    ):
        answer = dicflow(*command)
        assert answer.code == 0, answer.err
    Page.read(results / "report.html").assert_complete()
    table = rows(tmp_path / "tables" / "total_step_02.csv")
    lengths = [float(row["length_mm"]) for row in rows(photographs / "caliper.csv")]
    strain = np.nanmean([float(row["eyy"]) for row in table])
    assert strain == pytest.approx(lengths[-1] / lengths[0] - 1.0, rel=0.02)


def rows(path):
    """The rows of a table with a commented header."""
    return list(csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#")))
