"""Figures of a result: over the photograph, over the specimen, and messages for names that do not exist."""

from __future__ import annotations

import shutil
from types import SimpleNamespace

import numpy as np
import pytest

import dicflow
from dicflow.errors import ConfigurationError
from dicflow.kinds.quantities import BASIC
from dicflow.kinds.total import Total, TotalFacts
from dicflow.views import plots
from dicflow.views.figures import plot


@pytest.fixture(scope="module")
def result(pipeline, measured, tmp_path_factory):
    folder = tmp_path_factory.mktemp("plots") / "small"
    shutil.copytree(pipeline.parent, folder)
    return dicflow.Pipeline.load(folder / pipeline.name).result()


def test_a_total_lies_over_the_photograph(result):
    figure = plot(result, "total", "eyy", step=0)
    axes, bar = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [px]", "y [px]")
    assert bar.get_ylabel().endswith("[–]")
    assert axes.get_title() == result.steps("total")[0]
    (photo,), (mesh,) = axes.images, axes.collections
    shown = photo.get_extent()
    places = mesh.get_coordinates()[np.isfinite(mesh.get_coordinates()).all(axis=-1)]
    assert shown[0] <= places[:, 0].min() <= places[:, 0].max() <= shown[1]
    values = result.product("total", 0)["eyy"]
    assert mesh.get_array().compressed().mean() == pytest.approx(np.nanmean(values), rel=0.02)
    assert plots.saved(figure, "png").startswith(b"\x89PNG")


def test_the_range_is_that_of_the_maps_at_every_step(result):
    ranges = {plot(result, "total", "eyy", step=step).axes[0].collections[0].get_clim() for step in (0, 1)}
    assert ranges == {tuple(result.product("maps").attrs["quantities"]["eyy"]["range"])}


def test_a_total_in_mm(result):
    figure = plot(result, "total", "U", over="specimen")
    axes, bar = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("X [mm]", "Y [mm]")
    assert bar.get_ylabel() == "displacement U [mm]"
    low, high = axes.collections[0].get_clim()
    assert low == -high
    assert axes.collections[0].get_cmap().name == "RdBu_r"


def test_a_total_with_places_in_the_photograph_alone_is_shown_there():
    """As a stage of somebody else may write it for one camera."""
    rows, cols = np.mgrid[0:4, 0:5].astype(float)
    fields = {name: 1e-3 * cols for name in BASIC} | {"xy": np.stack([100 + 15 * cols, 80 + 14 * rows], axis=-1)}
    total = Total.write(fields, np.zeros(rows.shape, np.uint8), TotalFacts("precise", "px", {}, {"step_size": 15.0}))
    alone = SimpleNamespace(
        variant=lambda variant: alone, product=lambda stage, step: total, steps=lambda stage: ("step_1",),
        stages_of=lambda kind: [], task=lambda *place: "total/step_1",
    )  # fmt: skip
    axes = plot(alone, "total", "eyy", over="specimen").axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("X [px]", "Y [px]")
    assert np.array_equal(axes.collections[0].get_coordinates(), fields["xy"])
    assert axes.get_xlim()[0] < 100 < 160 < axes.get_xlim()[1]


def test_colours_on_request(result):
    assert plot(result, "total", "U", colours="jet").axes[0].collections[0].get_cmap().name == "jet"
    with pytest.raises(ConfigurationError, match="no colour map 'jett', did you mean 'jet'"):
        plot(result, "total", "U", colours="jett")


def test_reasons_are_named(result):
    _, bar = plot(result, "total", "status").axes
    assert "valid" in [label.get_text() for label in bar.get_yticklabels()]


def test_an_array_of_another_stage_is_drawn_on_its_grid(result):
    figure = plot(result, "disparity", "disparity")
    assert figure.axes[1].get_ylabel().endswith("[px]")


def test_names_that_do_not_exist(result):
    with pytest.raises(ConfigurationError, match=r"no quantity 'eyx' in total.*it has .*eyy"):
        plot(result, "total", "eyx")
    with pytest.raises(ConfigurationError, match=r"xyz is not one number per row and column; choose of .*eyy"):
        plot(result, "total", "xyz")
    with pytest.raises(ConfigurationError, match="no step '9'; it has"):
        plot(result, "total", "eyy", step="9")
