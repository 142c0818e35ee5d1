"""Photographs in memory: measured in one call, read as tables and datasets with coordinates, shown in notebooks."""

from __future__ import annotations

import gc

import numpy as np
import pytest

import dicflow
from dicflow.core.synthetic.planar import planar_pair
from dicflow.errors import ConfigurationError, StageError
from dicflow.io.rig import write_rig
from tests.stereo_scene import REGION, REST, RIG, photographs

pytestmark = pytest.mark.slow

SHIFT = (1.3, -0.4)
OUTLINE = [[40, 40], [160, 40], [160, 140], [40, 140]]
X0, Y0, X1, Y1 = (REGION[0] + 100, REGION[1] + 120, REGION[2] - 100, REGION[3] - 120)
STEREO_OUTLINE = [[X0, Y0], [X1, Y0], [X1, Y1], [X0, Y1]]
UP_MM = 0.2


@pytest.fixture(scope="module")
def planar():
    """One camera: nothing moves at step 1, a shift at step 2."""
    pair = planar_pair((200, 180), SHIFT, noise=1.0, seed=3)
    return dicflow.measure([pair.reference, pair.reference, pair.deformed], region=[OUTLINE])


@pytest.fixture(scope="module")
def spatial(tmp_path_factory):
    """Two cameras: a shift upwards, in a folder that stays."""
    folder = tmp_path_factory.mktemp("arrays")
    states = (REST, REST._replace(shift=(0.0, -UP_MM, 0.0)))
    left, right = zip(*(photographs(state) for state in states), strict=True)
    return dicflow.measure(left, right, RIG, [STEREO_OUTLINE], settings=["correlation.subset_size=25"], folder=folder)


def test_a_shift_of_one_camera_is_measured_in_pixels(planar):
    total = planar.dataset("total", -1)
    for name, expected in zip(("U", "V"), SHIFT, strict=True):
        assert total[name].attrs["units"] == "px"
        assert float(total[name].mean()) == pytest.approx(expected, abs=0.005)


def test_a_shift_of_two_cameras_is_measured_in_millimetres(spatial):
    total = spatial.dataset("total", 0)
    assert total.V.attrs["units"] == "mm"
    assert float(total.V.mean()) == pytest.approx(-UP_MM, abs=0.002)
    assert spatial.node("correlation").subset_size == 25


def test_the_folder_of_a_result_goes_with_it_unless_it_is_named(spatial):
    pair = planar_pair((120, 120), SHIFT, seed=3)
    outline = [[30, 30], [90, 30], [90, 90], [30, 90]]
    result = dicflow.measure([pair.reference, pair.deformed], region=[outline])
    folder = result.store_folder.parent
    assert folder.is_dir()
    alone = result.variant("#1")
    del result
    gc.collect()
    assert np.isfinite(alone.product("total", 0)["U"]).any()
    del alone
    gc.collect()
    assert not folder.exists()
    assert (spatial.store_folder.parent / "pipeline.yaml").is_file()


def test_the_rig_may_be_a_file(spatial, tmp_path):
    """The photographs are too small for it, which its stage says."""
    write_rig(tmp_path / "mine.json", RIG)
    pair = planar_pair((120, 120), SHIFT, seed=3)
    size = " × ".join(map(str, RIG.left.size))
    with pytest.raises(StageError, match=size):
        dicflow.measure([pair.reference] * 2, [pair.deformed] * 2, tmp_path / "mine.json")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([np.zeros((9, 9), np.uint8)] * 2, None, RIG), "belong together"),
        (([np.zeros((9, 9, 3), np.uint8)] * 2,), r"shape \(9, 9, 3\)"),
        (([np.zeros((9, 9))] * 2,), "type float64"),
        (([np.zeros((9, 9), np.uint8)],), "got 1 left"),
        (([np.zeros((9, 9), np.uint8)] * 3, [np.zeros((9, 9), np.uint8)] * 2, RIG), "3 left and 2 right"),
    ],
)
def test_what_cannot_be_measured_is_refused(arguments, words):
    with pytest.raises(ConfigurationError, match=words):
        dicflow.measure(*arguments)


def test_steps_are_selected_by_their_number_in_the_test(planar):
    whole = planar.dataset("total", chunks="auto")
    assert whole.step.values.tolist() == [1, 2]
    assert whole.step_name.values.tolist() == ["step_0001", "step_0002"]
    for number in (1, 2):
        alone = planar.dataset("total", f"step_{number:04d}")
        assert int(alone.step) == number
        np.testing.assert_array_equal(whole.U.sel(step=number), alone.U)
    assert int(planar.dataset("photos", 0).step) == 0


def test_points_have_their_places_as_coordinates(planar, spatial):
    """The grid of the first photograph, also where a point is unknown; in space those of the product."""
    for result in (planar, spatial):
        total = result.dataset("total", -1)
        known = np.isfinite(total.xy_reference.values[..., 0])
        x, y = np.meshgrid(total.x_px, total.y_px)
        np.testing.assert_allclose(np.stack([x, y], -1)[known], total.xy_reference.values[known])
        lazy = result.dataset("total", chunks="auto")
        np.testing.assert_array_equal(lazy.x_px, total.x_px)
    for k, name in enumerate(("x_mm", "y_mm", "z_mm")):
        np.testing.assert_array_equal(total[name], total.xyz_reference[..., k])
        np.testing.assert_array_equal(lazy[name], total.xyz_reference[..., k])
    assert "x_mm" not in planar.dataset("total", 0).coords


def test_a_failure_is_raised():
    with pytest.raises(StageError, match="region"):
        dicflow.measure([np.full((120, 120), 90, np.uint8)] * 2)


def test_a_result_that_runs_once_has_no_step(spatial):
    assert not spatial.dataset("rig").coords


def test_what_is_no_table_is_refused_with_what_to_do(planar):
    with pytest.raises(ConfigurationError, match=r"total gives a product of kind total.*dataset\(\)"):
        planar.to_dataframe("total", 0)


def test_a_result_and_a_pipeline_say_what_they_are(spatial):
    pipeline = dicflow.Pipeline.load(spatial.store_folder.parent / "pipeline.yaml")
    assert repr(pipeline) == "<dicflow.Pipeline pipeline.yaml: 9 stages>"
    count = len(spatial.graph.tasks)
    assert repr(spatial) == f"<dicflow.Result: 9 stages; {count} of {count} products stored>"
    for shown in (pipeline, spatial):
        page = shown._repr_html_()
        assert page.count("<tr>") == 10
        assert "<td>triangulate</td>" in page
    assert "left: &quot;left/*.png&quot;" in pipeline._repr_html_()
