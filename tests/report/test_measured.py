"""What the report measures itself, on the small experiment and where it is known."""

import json

import numpy as np
import pytest

from dicflow.engine.product import Product, Variable
from dicflow.pipeline import Pipeline
from dicflow.report import measured as module
from tests.pages import context_of


@pytest.fixture(scope="module")
def context(pipeline, measured, tmp_path_factory):
    return context_of(Pipeline.load(pipeline), tmp_path_factory.mktemp("report"))


def test_the_pattern_is_that_of_the_region(context):
    found = module.pattern(context)
    assert 1.0 < found["size_px"] < 12.0
    assert found["contrast"] > 0.1


@pytest.mark.parametrize(("region", "images", "known"), [("region", "photos", True), ("other", "photos", False)])
def test_a_correlation_knows_the_pattern_of_its_own_region(region, images, known):
    class Followed:
        def stages_of(self, kind):
            return ["points"]

        def source(self, stage, port):
            return {"region": region, "images": images}[port]

        def has(self, stage, step):
            return (stage, step) == ("points", 0)

        def product(self, stage, step):
            return Product("correlation", {}, {"pattern": {"size_px": 4.5}})

    assert module._kept_pattern(Followed(), "region", "photos") == ({"size_px": 4.5} if known else None)


def test_properties_of_a_known_pattern():
    levels = np.zeros((64, 64), np.uint8)
    levels[:, ::2] = 200
    image = Product("images", {"left": Variable(("row", "col"), levels)})
    square = {"exterior": [[1, 1], [62, 1], [62, 62], [1, 62]], "holes": []}
    region = Product("region", {}, {"polygons": [square]})
    found = json.loads(module._measured(image, region))
    assert found["contrast"] == pytest.approx(1.0, abs=0.05)
    assert found["saturated"] == 0.0
    flat = Product("images", {"left": Variable(("row", "col"), np.full((64, 64), 9, np.uint8))})
    assert json.loads(module._measured(flat, region))["contrast"] == 0.0


def test_cameras_and_distance_are_those_of_the_products(context):
    result = context.result
    rig = result.product("rig").attrs["rig"]
    found = module.cameras(context, "rig")
    assert found.size == tuple(rig["left"]["size"])
    assert found.focal_px == (rig["left"]["matrix"][0][0], rig["right"]["matrix"][0][0])
    depth = result.product(result.stages_of("cloud")[-1], 0)["xyz"][..., 2]
    assert module.stand_off_mm(context) == np.nanmedian(depth)


def test_it_is_measured_once(context, monkeypatch):
    first = module.pattern(context), module.stand_off_mm(context)
    for name in ("_measured", "_median_depth"):
        monkeypatch.setattr(module, name, lambda *_: pytest.fail("measured again"))
    assert (module.pattern(context), module.stand_off_mm(context)) == first
