"""The demonstration: one command from nothing to the report."""

import pytest
from small import BOARDS, dicflow

from dicflow.synth import latex_experiment
from tests.pages import Page

pytestmark = pytest.mark.slow


def test_the_demonstration_ends_with_a_report(tmp_path, monkeypatch):
    """With fewer and smaller photographs than people get."""
    small = latex_experiment(3, scale=0.3, steps=(0, 5, 8), boards=BOARDS)._replace(noise=1.0)
    monkeypatch.setattr("dicflow.synth.sample_experiment", lambda: small)
    folder = tmp_path / "demo"
    answer = dicflow("demo", folder)
    assert answer.code == 0, answer.err
    Page.read(folder / "results" / "pipeline" / "report.html").assert_complete()
    assert list((folder / "results" / "pipeline").rglob("*eyy*.png"))
    assert f"dicflow app {folder}" in answer.out
    dicflow("demo", folder).refuses(2, "is not empty", "--force")
