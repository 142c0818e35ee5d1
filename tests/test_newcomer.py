"""From photographs to a report and a table in four commands, and from nothing to a report in one."""

import csv
import shutil

import numpy as np
import pytest
from small import Answer, dicflow

from tests.boards_once import recognise_boards_once
from tests.pages import Page

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(pipeline, tmp_path_factory):
    """Photographs of specimen and boards, and a caliper's table; nothing that dicflow has written."""
    left_out = shutil.ignore_patterns("*.yaml", "truth", ".dicflow", "results", "*.geojson")
    return shutil.copytree(pipeline.parent, tmp_path_factory.mktemp("newcomer") / "my test", ignore=left_out)


@pytest.fixture(scope="module")
def answers(folder) -> list[Answer]:
    """Of the four commands, one after the other."""
    file, store, results = folder / "pipeline.yaml", folder.parent / "store", folder.parent / "results"
    with pytest.MonkeyPatch.context() as patch:
        recognise_boards_once(patch)
        return [
            dicflow("init", folder, "--square", "14.5 mm"),
            dicflow("run", file, "--store", store, "--output", results, "--scheduler", "sync"),
            dicflow("report", file, "--store", store, "--output", results),
            dicflow("export", file, "--store", store, "--output", folder.parent / "tables"),
        ]


def test_four_commands(folder, answers):
    assert [answer.code for answer in answers] == [0] * 4, [answer.err for answer in answers]
    Page.read(folder.parent / "results" / "report.html").assert_complete()
    table = rows(folder.parent / "tables" / "total_step_02.csv")
    lengths = [float(row["length_mm"]) for row in rows(folder / "caliper.csv")]
    strain = np.nanmean([float(row["eyy"]) for row in table])
    assert strain == pytest.approx(lengths[-1] / lengths[0] - 1.0, rel=0.02)


def rows(path):
    """The rows of a table with a commented header."""
    return list(csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#")))


@pytest.mark.usefixtures("answers", "boards_recognised_once")
def test_the_demonstration_ends_with_a_report(pipeline, folder, tmp_path, monkeypatch):
    """On photographs that are rendered and measured already, fewer and smaller ones than people get."""

    def rendered(demo, *_, **__):
        shutil.copytree(pipeline.parent, demo, ignore=shutil.ignore_patterns("*.yaml", ".dicflow", "results"))
        shutil.copytree(folder.parent / "store", demo / ".dicflow")

    monkeypatch.setattr("dicflow.synth.write_experiment", rendered)
    demo = tmp_path / "demo"
    answer = dicflow("demo", demo)
    assert answer.code == 0, answer.err
    Page.read(demo / "results" / "pipeline" / "report.html").assert_complete()
    assert list((demo / "results" / "pipeline").rglob("*eyy*.png"))
    assert f"dicflow app {demo}" in answer.out
    dicflow("demo", demo).refuses(2, "is not empty", "--force")
