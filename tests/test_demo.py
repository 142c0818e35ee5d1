"""The demonstration: one command from nothing to the report."""

import shutil

import pytest
from small import dicflow

from tests.pages import Page

pytestmark = pytest.mark.slow


def test_the_demonstration_ends_with_a_report(pipeline, tmp_path, monkeypatch):
    """On photographs that are rendered already, fewer and smaller ones than people get."""
    left_out = shutil.ignore_patterns("*.yaml", ".dicflow", "results")
    monkeypatch.setattr(
        "dicflow.synth.write_experiment",
        lambda folder, *_, **__: shutil.copytree(pipeline.parent, folder, ignore=left_out),
    )
    folder = tmp_path / "demo"
    answer = dicflow("demo", folder)
    assert answer.code == 0, answer.err
    Page.read(folder / "results" / "pipeline" / "report.html").assert_complete()
    assert list((folder / "results" / "pipeline").rglob("*eyy*.png"))
    assert f"dicflow app {folder}" in answer.out
    dicflow("demo", folder).refuses(2, "is not empty", "--force")
