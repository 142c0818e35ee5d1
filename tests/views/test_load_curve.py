"""The plots of the summary, as SVG inside a page."""

import pytest

from dicflow.views.load_curve import Axis, load_curves
from tests.pages import Page

STEPS = ("a", "b", "c")
PHASES = ("loading", "loading", "unloading")
VALUES = {
    "load_g": (0.0, 100.0, 50.0),
    "caliper_displacement_mm": (0.0, 2.0, 1.0),
    "dic_displacement_mm": (0.0, None, 1.01),
    "caliper_strain": (0.0, 0.2, 0.1),
    "dic_strain": (0.0, 0.21, 0.11),
    "sigma_strain": (0.0, 1e-5, 1e-5),
}


def test_a_plot_of_displacements_and_one_of_strains_over_load():
    plots = [Page(text) for text in load_curves(STEPS, PHASES, VALUES)]
    assert [{text for text in plot.texts if "[" in text} for plot in plots] == [
        {"load [g]", "displacement [mm]"},
        {"load [g]", "strain [–]"},
    ]
    assert all({"caliper", "DIC"} <= set(plot.texts) for plot in plots)
    assert not any("sigma" in plot.text for plot in plots)


def test_a_plot_over_another_axis():
    values = {"force_N": (0.0, 2.5, None), "E · strain": (0.0, 0.2, 0.1)}
    plots = [Page(text) for text in load_curves(STEPS, PHASES, values, Axis("force_N", "force [N]"))]
    assert [{text for text in plot.texts if "[" in text} for plot in plots] == [{"force [N]", "strain [–]"}]


def test_without_a_load_the_steps_are_named():
    plots = load_curves(STEPS, (), {"mean_V_px": (0.0, 3.0, None), "mean_eyy": (0.0, 0.1, 0.2)})
    assert [text for text in Page(plots[0]).texts if "[" in text] == ["displacement [px]"]
    assert all(set(STEPS) <= set(Page(plot).texts) for plot in plots)


def test_values_of_one_kind_make_one_plot():
    assert len(load_curves(STEPS, (), {"name · strain": (0.0, 0.1, 0.2)})) == 1


@pytest.mark.parametrize("word", ["http", "<script"])
def test_a_plot_fetches_nothing_and_takes_the_colour_of_the_page(word):
    for text in load_curves(STEPS, PHASES, VALUES):
        assert word not in text
        assert "currentColor" in text


def test_the_same_values_give_the_same_bytes():
    assert load_curves(STEPS, PHASES, VALUES) == load_curves(STEPS, PHASES, VALUES)
