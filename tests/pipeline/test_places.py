"""Places of points of rectified images in the photographs."""

import numpy as np

from dicflow.core.cameras.rectification import raw_to_rectified, rectification
from dicflow.kinds.rig import CalibratedRig
from dicflow.pipeline import Pipeline
from dicflow.pipeline.places import Places


def test_places_in_rectified_images_are_carried_back_into_the_photograph(pipeline, measured):
    result = Pipeline.load(pipeline).result()
    places = Places(result)
    assert (places.images, places.photographs, places.grid) == ("pair", "photos", "track")
    rig = CalibratedRig.read(result.product("rig")).cameras
    rectified = rectification(rig)
    found = places.at_first_step()
    back = raw_to_rectified(found, rig.left, rectified.rotation_left, rectified.matrix_left)
    np.testing.assert_allclose(back, result.product("track", 0)["points"], atol=1e-6)
