import json
import re
from base64 import b64decode
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from dicflow.core.status import Status
from dicflow.engine.product import Product, Variable
from dicflow.kinds.quantities import REPORTED
from dicflow.pipeline import Pipeline
from dicflow.pipeline.result import ArrayFacts
from dicflow.report import fields as module
from dicflow.report.fields import fields
from dicflow.views import step_maps
from dicflow.views.colours import Look
from dicflow.views.figures import plot
from dicflow.views.maps import png
from dicflow.views.step_maps import Overview, StepMaps, worst_corner
from tests.pages import context_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def loaded(pipeline, measured):
    return Pipeline.load(pipeline)


def data_of(section):
    return json.loads(re.search(r'id="fields-data">(.*?)</script>', section.body, re.DOTALL)[1])


@pytest.fixture(scope="module")
def section(loaded, tmp_path_factory):
    return fields(context_of(loaded, tmp_path_factory.mktemp("report")))


@pytest.fixture(scope="module")
def data(section):
    return data_of(section)


def test_each_step_has_each_quantity_over_both_photographs(loaded, data):
    names = [quantity["name"] for quantity in data["quantities"]]
    assert names == ["eyy", "U", "V", "W", "exx", "gxy"]
    assert [step["name"] for step in data["steps"]] == list(loaded.result().steps("total"))
    for step in data["steps"]:
        assert set(step["maps"]["deformed"]) == set(step["maps"]["reference"]) == set(names)
        assert all(step["maps"]["directions"][over].startswith("M") for over in ("reference", "deformed"))
    assert data["reference"]


def test_a_label_has_measure_window_and_unit(data):
    labels = {quantity["name"]: quantity["label"] for quantity in data["quantities"]}
    assert labels["U"] == "displacement U [mm]"
    assert labels["eyy"] == "engineering strain εyy = |F e₂| − 1, window 80 × 20 px [–]"
    assert all(quantity["bar"].startswith("<svg") for quantity in data["quantities"])


def test_points_are_counted_by_their_status_inside_the_region(loaded, data):
    result = loaded.result()
    inside = np.isfinite(result.product("track", 0)["points"]).all(axis=-1)
    for number, step in enumerate(data["steps"]):
        status = result.product("total", number)["status"][inside]
        assert step["maps"]["counts"] == {
            Status(code).label: int((status == code).sum()) for code in np.unique(status).tolist()
        }


def test_a_full_map_is_linked_where_it_lies_beside_the_page(loaded, pipeline, data):
    folder = pipeline.parent / "results" / loaded.name
    beside = data_of(fields(context_of(loaded, folder)))["quantities"][0]
    assert beside["files"] == {step: f"maps/eyy/{step}.png" for step in loaded.result().steps("total")}
    assert beside["full"] is None
    assert data["quantities"][0]["files"] == {}


def test_a_quantity_without_maps_beside_the_page_has_a_full_map_in_it(loaded, pipeline, data):
    """The quick start's maps draw εyy alone."""
    quantities = data_of(fields(context_of(loaded, pipeline.parent / "results" / loaded.name)))["quantities"]
    embedded = {quantity["name"]: quantity["full"] for quantity in quantities if quantity["full"]}
    assert list(embedded) == ["U", "V", "W", "exx", "gxy"]
    peak = data["steps"][data["start"]]["name"]
    for name, picture in embedded.items():
        drawn = png(plot(loaded.result(), "total", name, step=peak, over="specimen"))
        with Image.open(BytesIO(b64decode(picture))) as image, Image.open(BytesIO(drawn)) as expected:
            assert abs(image.width - expected.width) < 60
            assert abs(image.height - expected.height) < 20
    assert len(set(embedded.values())) == len(embedded)
    assert all(quantity["full"] for quantity in data["quantities"])


def test_the_second_build_draws_nothing(loaded, tmp_path, monkeypatch):
    first = fields(context_of(loaded, tmp_path))
    for slow in ("field_png", "reason_png", "photo_jpeg", "direction_path", "cell_index", "colour_range"):
        monkeypatch.setattr(f"dicflow.views.step_maps.{slow}", lambda *given: pytest.fail("drawn again"))
    assert fields(context_of(loaded, tmp_path)) == first


def test_each_picture_is_drawn_once(loaded, tmp_path, monkeypatch):
    """Also those of the last step, on which the size of the page is tried."""
    drawn, draw = [], step_maps.field_png

    def noted(values, index, look):
        drawn.append((look.quantity, values.tobytes(), index.tobytes()))
        return draw(values, index, look)

    monkeypatch.setattr(step_maps, "field_png", noted)
    data = data_of(fields(context_of(loaded, tmp_path)))
    assert len(drawn) == len(set(drawn)) == 2 * len(data["quantities"]) * len(data["steps"])


def test_places_in_rectified_images_are_carried_back_into_the_photograph(loaded):
    from dicflow.core.cameras.rectification import raw_to_rectified, rectification
    from dicflow.kinds.rig import CalibratedRig
    from dicflow.pipeline.places import Places

    result = loaded.result()
    places = Places(result)
    assert (places.images, places.photographs, places.grid) == ("pair", "photos", "track")
    rig = CalibratedRig.read(result.product("rig")).cameras
    rectified = rectification(rig)
    found = places.at_first_step()
    back = raw_to_rectified(found, rig.left, rectified.rotation_left, rectified.matrix_left)
    np.testing.assert_allclose(back, result.product("track", 0)["points"], atol=1e-6)


def test_a_cell_has_the_gravest_status_of_its_corners():
    status = np.array([[0, 0, 13], [0, 1, 0]], np.uint8)
    assert worst_corner(status).tolist() == [1, 13, 0]


class Noise:
    """A result whose every array is noise."""

    def __init__(self):
        rng = np.random.default_rng(1)
        grid = np.stack(np.meshgrid(np.arange(300, 1600, 7.0), np.arange(100, 1300, 7.0)), axis=-1)
        fields = {name: rng.normal(size=grid.shape[:2]) for name in (*REPORTED, "angle")}
        fields |= {"xy": grid, "status": rng.integers(0, 15, grid.shape[:2], dtype=np.uint8)}
        self.boxes = [(300.0, 100.0, 1600.0, 1300.0)]
        self.arrays_of_noise = fields | {"left": rng.integers(0, 256, (1440, 1920), dtype=np.uint8)}

    def product(self, stage, step=None):
        kind = "images" if stage == "photos" else "total"
        return Product(kind, {name: Variable(("row", "col"), values) for name, values in self.arrays_of_noise.items()})

    def digest(self, stage, step=None):
        return f"{stage} {step}"

    def arrays(self, stage, step=None):
        return {name: ArrayFacts(name, values.shape, values.dtype.str) for name, values in self.arrays_of_noise.items()}


class Fixed:
    """Places of points that do not move."""

    photographs = images = "photos"
    grid = None

    def __init__(self):
        self.xy = Noise().arrays_of_noise["xy"]

    def at_step(self, total):
        return self.xy

    def at_first_step(self):
        return self.xy


@pytest.mark.parametrize("count", [22, 40])
def test_steps_of_noise_stay_within_the_page(count):
    noise = Noise()
    maps = StepMaps(noise, "total", Fixed(), has_grid=True, keep=lambda sources, make: make())
    looks = [Look(name, name, "1", (-2.0, 2.0), "viridis") for name in REPORTED]
    steps = [f"step_{number}" for number in range(count)]
    crop = maps.crop(Overview(noise.boxes, (1920, 1440), {}), steps, looks)
    assert count * len(json.dumps(maps.at_step("step_1", crop, looks))) < 7.0e6
    assert max(crop.size) >= 80


def test_of_many_steps_as_many_as_fit_are_shown():
    steps = [f"step_{number}" for number in range(500)]
    shown = module._spread(steps)
    assert len(set(shown)) == 40
    assert (shown[0], shown[-1]) == (steps[0], steps[-1])
    assert module._spread(steps[:3]) == steps[:3]
    assert module._spread(steps[:1]) == steps[:1]
    assert module._spread([]) == []


def test_a_step_that_lost_most_points_is_warned_of():
    drawn = {"step_01": {"counts": {"valid": 9, "hidden": 1}}, "step_02": {"counts": {"valid": 1, "hidden": 3}}}
    assert module._few_points(drawn) == ("1 of 2 steps have lost most points; step_02 has values at 25%.",)
    assert module._few_points({"step_01": drawn["step_01"]}) == ()


def test_text_of_the_user_cannot_end_the_data():
    assert "<" not in module._as_json({"name": "</script><b>&"})
    assert json.loads(module._as_json({"name": "</script><b>&"})) == {"name": "</script><b>&"}


def test_a_store_without_totals(pipeline, tmp_path):
    empty = Pipeline.load(pipeline, store=tmp_path / "store")
    assert "No step has displacements" in fields(context_of(empty, tmp_path)).body
