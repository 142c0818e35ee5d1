import numpy as np
import pytest

from dicflow.core.matching.features import Features
from dicflow.kinds.features import FeatureSet
from tests.kinds.layouts import layouts, long_names, stored


def features(dtype):
    draw = np.random.default_rng(2)
    single = (draw.uniform(0, 300, (7, 2)), *(draw.uniform(1, 9, 7) for _ in range(3)))
    return Features(*(array.astype(np.float32) for array in single), draw.integers(0, 255, (7, 61)).astype(dtype))


@pytest.mark.parametrize("dtype", [np.float32, np.uint8])
def test_features_come_back_bit_for_bit(dtype):
    product = stored(FeatureSet.write(features(dtype), "AKAZE", (10, 20, 200, 180), (240, 340)))
    read = FeatureSet.read(product)
    for name, expected in features(dtype)._asdict().items():
        np.testing.assert_array_equal(getattr(read.features, name), expected)
        assert getattr(read.features, name).dtype == expected.dtype
    assert read.image_size == (240, 340)
    assert read.summary == {"features": 7}


def test_arrays_of_features_have_axes_and_units():
    product = FeatureSet.write(features(np.uint8), "AKAZE", (0, 0, 240, 340), (240, 340))
    assert layouts(product) == {
        "xy": ("feature component", "px"),
        "size": ("feature", "px"),
        "angle": ("feature", "deg"),
        "response": ("feature", "1"),
        "descriptors": ("feature d", "1"),
    }
    assert long_names(product)["descriptors"] == "AKAZE descriptor"
