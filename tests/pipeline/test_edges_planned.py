"""A sheet whose edges are not in view, found in the plan from the region and the size of the photographs."""

import cv2
import numpy as np
import pytest

from dicflow.engine.node import Joined
from dicflow.errors import ConfigurationError
from dicflow.pipeline import Pipeline
from dicflow.stages.images import Images
from dicflow.stages.region import Region
from dicflow.stages.sheet import Sheet

WIDTH, HEIGHT = 80, 60
STAGES = """
  photos: {stage: images, left: "left/*.png", right: "right/*.png"}
  boards: {stage: images, left: "left/*.png", right: "right/*.png"}
  corners: {stage: corners, images: boards, size: [9, 6]}
  rig: {stage: calibrate, square: 14.5 mm}
  load: {stage: channels, images: photos, file: weights.csv}
  features: {stage: features, images: photos}
  matches: {stage: match, images: photos}
  correlation: {stage: correlate, images: photos}
  stereo: {stage: stereo, images: photos}
  points: {stage: triangulate}
  total: {stage: deformation, points: points}
"""
LEFT, RIGHT = "rectangle: [1, 5, 70, 55]", "rectangle: [10, 5, 78.5, 55]"
HOLE = "polygons: [{exterior: [[10, 5], [70, 5], [70, 55], [10, 55]], holes: [[[20, 20], [30, 20], [30, 30]]]}]"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Photographs of two steps, weights, and a mask that is white up to the right border."""
    path = tmp_path_factory.mktemp("edges")
    for side in ("left", "right"):
        (path / side).mkdir()
        for step in range(2):
            cv2.imwrite(str(path / side / f"{step}.png"), np.full((HEIGHT, WIDTH), 40 + step, np.uint8))
    (path / "weights.csv").write_text("step,load_g\n0,0\n1,100\n")
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[5:55, 10:] = 255
    cv2.imwrite(str(path / "mask.png"), mask)
    ring = "[[0.5, 5], [70, 5], [70, 55], [0.5, 55]]"
    (path / "region.geojson").write_text('{"type": "Polygon", "coordinates": [' + ring + "]}")
    return path


def plan(folder, region):
    region = f"  region: {{stage: region, images: photos, {region}}}\n"
    stages = f"{STAGES}{region}  strip: {{stage: sheet, thickness: 0.21 mm, u_thickness: 5 um}}\n"
    (folder / "p.yaml").write_text(f"dicflow: 1\nstages:{stages}")
    return Pipeline.load(folder / "p.yaml").plan()


@pytest.mark.parametrize(
    ("region", "message"),
    [
        (LEFT, "the left edge of the specimen is not in view"),
        (RIGHT, "the right edge of the specimen is not in view"),
        ("file: region.geojson", "the left edge of the specimen is not in view"),
        ("file: mask.png", "the right edge of the specimen is not in view"),
        (HOLE, "the region has holes or several parts"),
    ],
)
def test_an_edge_out_of_view_is_refused_before_anything_runs(folder, region, message):
    with pytest.raises(ConfigurationError, match=rf"p\.yaml:\d+:\d+: strip.region: {message}"):
        plan(folder, region)


@pytest.mark.parametrize(
    ("region", "sheet"),
    [
        ({"rectangle": (10, 5, 70, 55)}, {}),
        ({"polygons": [[[0, 5], [79, 5], [70, 10], [70, 55], [10, 55], [10, 10]]]}, {}),
        ({"auto": True}, {}),
        ({"rectangle": (1, 5, 70, 55)}, {"width": 20.0}),
    ],
)
def test_what_may_be_measured_is_not_refused(region, sheet):
    """Both edges in view, a border touched at one end, a region that is not known yet, and a width that is given."""
    first = {"left": {"width": WIDTH, "height": HEIGHT}}
    photos = Joined(Images(left="left/*.png"), ("0",), first, (), {})
    joined = {"region": Joined(Region(**region), (), {}, (), {"images": photos})}
    assert list(Sheet(thickness=0.21, u_thickness=0.005, **sheet).problems(joined)) == []
