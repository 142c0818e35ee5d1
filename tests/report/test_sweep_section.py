"""The section of a sweep, on the small experiment."""

import os
import shutil
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from dicflow.pipeline import Pipeline
from dicflow.report.context import Context
from dicflow.report.pieces import Pieces
from dicflow.report.sweep import sweep
from dicflow.views.sweep import small_multiples, step_figure

DEGREES = "{x: [1, 1], y: [1, 1], z: [1, 1]}, {x: [2, 2], y: [2, 2], z: [2, 2]}, {x: [3, 3], y: [3, 3], z: [3, 3]}"


@pytest.fixture(scope="module")
def swept(pipeline, measured, tmp_path_factory):
    """Three degrees of the surface without robust weights, beside a copy of the pipeline and in a copy of its store."""
    path = shutil.copytree(pipeline.parent, tmp_path_factory.mktemp("swept") / "small") / "degrees.yaml"
    text = pipeline.read_text()
    path.write_text(f"{text}\nsweep:\n  grid: {{surface.degree: [{DEGREES}], surface.robust: [none]}}\n")
    os.utime(path, (1e9, 1e9))
    loaded = Pipeline.load(path)
    loaded.run(scheduler="sync", workers=1)
    return loaded


def context(loaded, folder):
    return Context(loaded, loaded.result(), None, Pieces(folder / ".report", "code"), folder)


def test_one_variant_has_no_section(pipeline, measured, tmp_path):
    assert sweep(context(Pipeline.load(pipeline), tmp_path)) is None


def test_squares_fall_with_the_degree_and_are_in_the_table(swept, tmp_path):
    section = sweep(context(swept, tmp_path))
    squares = [row["surface.sse_z_mm2"] for row in swept.result().table()]
    assert squares == sorted(squares, reverse=True)
    assert squares[0] > squares[-1]
    differs, _, equal = section.body.partition("not differ")
    assert "surface.sse_z_mm2" in differs
    assert "rig.rms_px" not in differs
    assert "rig.rms_px" in equal
    assert "#3" in differs
    assert section.warnings == ()
    assert section.body.count("data:image/png") == 6  # means, steps, and four fields


def test_second_time_nothing_is_drawn(swept, tmp_path, monkeypatch):
    first = sweep(context(swept, tmp_path))
    monkeypatch.setattr("dicflow.views.maps.png", None)
    assert sweep(context(swept, tmp_path)) == first


def test_missing_variants_are_named(swept, tmp_path):
    empty = Pipeline.load(swept.path, store=tmp_path / "store")
    section = sweep(context(empty, tmp_path))
    assert len(section.warnings) == 3
    assert "#2" in section.warnings[1]
    assert "data:image/png" not in section.body


def test_curves_have_one_line_per_variant_and_a_unit():
    values = [{"a.b": 1}, {"a.b": 2}]
    figure = step_figure(values, {"rig.rms_px": [[1.0, 2.0], [3.0, np.nan]]}, ["one", "two"])
    axes = figure.axes[0]
    assert [line.get_label() for line in axes.lines] == ["b 1", "b 2"]
    assert axes.lines[0].get_ydata().tolist() == [1.0, 2.0]
    assert axes.get_ylabel() == "[px]"
    assert [text.get_text() for text in axes.get_xticklabels()] == ["one", "two"]


def test_fields_of_all_variants_share_one_range(swept):
    """The same field in several variants has the same colours in each, also beside one of other values."""
    total = swept.result().product("total", -1)
    strain = total.variables["eyy"]
    stretched = np.where(np.arange(len(strain.values))[:, None] < len(strain.values) // 2, 2.0, 1.0) * strain.values
    other = replace(total, variables={**total.variables, "eyy": strain._replace(values=stretched)})
    alike, differing = (_two_maps([total, second]) for second in (total, other))
    np.testing.assert_array_equal(*alike)
    equal = (differing[0] == differing[1]).all(axis=-1).mean(axis=1)
    third = len(equal) // 3
    assert equal[-third:].min() == 1.0
    assert equal[:third].max() < 0.9


def _two_maps(totals):
    """The pixels (row, col, 3) of two variants' maps."""
    drawn = np.asarray(Image.open(BytesIO(small_multiples(totals, ["#1", "#2"], "eyy"))).convert("RGB"), int)
    coloured = np.ptp(drawn, axis=-1) > 20
    columns = np.flatnonzero(coloured[len(drawn) // 2])
    runs = np.split(columns, np.flatnonzero(np.diff(columns) > 5) + 1)
    assert len(runs) == 3  # two maps and the bar
    drawn = drawn[coloured[:, columns[0]]]  # without the names above
    return [drawn[:, run[0] : run[-1] + 1] for run in runs[:2]]
