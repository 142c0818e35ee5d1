"""Panels of the scalars of a sweep."""

import math

import numpy as np
import pytest
from matplotlib.figure import Figure

from dicflow.views.maps import png
from dicflow.views.sweep import sweep_figure
from dicflow.views.variant_names import variant_labels, variant_names

VALUES = [{"surface.degree.z": [1, 1]}, {"surface.degree.z": [2, 2]}]
TABLE = [
    {"surface.degree.z": [1, 1], "surface.sse": 3.0, "surface.same": 1.0, "rig.rms": math.nan},
    {"surface.degree.z": [2, 2], "surface.sse": 1.0, "surface.same": 1.0, "track.only_here": 5.0},
]


def panels(figure):
    return {axes.get_title(): axes for axes in figure.axes if axes.get_title()}


def test_a_panel_for_each_scalar_that_differs():
    figure = sweep_figure(VALUES, TABLE)
    assert isinstance(figure, Figure)
    assert set(panels(figure)) == {"surface.sse"}
    assert len([axes for axes in figure.axes if axes.axison]) == 1
    (dots,) = panels(figure)["surface.sse"].lines
    assert dots.get_ydata().tolist() == [3.0, 1.0]
    assert panels(figure)["surface.sse"].get_ylim()[0] == 0
    labels = [text.get_text() for text in panels(figure)["surface.sse"].get_xticklabels()]
    assert (panels(figure)["surface.sse"].get_xlabel(), labels) == ("z", ["1,1", "2,2"])


@pytest.mark.parametrize("sign", [1, -1])
def test_dots_that_hardly_differ_stay_distinguishable(sign):
    rows = [{"a.b": sign * 100.0, "a.c": 1.0, "a.d": sign * 1.0}, {"a.b": sign * 101.0, "a.c": 1.00001, "a.d": 0.0}]
    found = panels(sweep_figure(VALUES, rows))
    assert set(found) == {"a.b", "a.d"}
    assert np.abs(found["a.b"].get_ylim()).min() > 99
    assert 0 in found["a.d"].get_ylim()


def test_nothing_that_differs_is_an_empty_figure_and_equal_tables_give_equal_bytes():
    assert panels(sweep_figure(VALUES, [{}, {}])) == {}
    assert png(sweep_figure(VALUES, TABLE)) == png(sweep_figure(VALUES, TABLE))


def test_variants_of_several_parameters_name_them():
    values = [{"surface.degree.z": [1, 1], "surface.robust": robust} for robust in ("none", "LAR")]
    (panel,) = panels(sweep_figure(values, TABLE)).values()
    assert panel.get_xlabel() == ""
    assert [text.get_text() for text in panel.get_xticklabels()] == ["z 1,1\nrobust none", "z 1,1\nrobust LAR"]


def test_variants_whose_names_have_no_room_side_by_side_are_numbered():
    values = [{"total.window": f"{side} px", "points.step_size": step} for side in (30, 50, 90) for step in (5, 9)]
    rows = [{**row, "total.sigma": float(place)} for place, row in enumerate(values)]
    (panel,) = panels(sweep_figure(values, rows)).values()
    assert panel.get_xlabel() == "variant"
    assert [text.get_text() for text in panel.get_xticklabels()] == [f"#{number}" for number in range(1, 7)]


def test_labels():
    assert variant_labels([{"a.b": {"x": [1, 2]}, "c.d": "LAR"}]) == ["b x1,2\nd LAR"]
    assert variant_names([{"a.b": 1, "c.d": [1, 2]}]) == ["b 1, d 1,2"]
