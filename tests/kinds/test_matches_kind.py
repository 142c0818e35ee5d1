import numpy as np

from dicflow.core.matching.steps import Matching
from dicflow.kinds.matches import Matches
from tests.kinds.layouts import layouts, stored

DRAW = np.random.default_rng(3)
REFERENCE, DEFORMED = (DRAW.uniform(0, 300, (9, 2)) for _ in range(2))
FEATURES = DRAW.uniform(0, 300, (20, 2)).astype(np.float32)


def write():
    return stored(Matches.write(REFERENCE, DEFORMED, FEATURES, (240, 340), Matching(ratio=0.7), {"matches": 9}))


def test_positions_are_kept_in_single_precision():
    matches = Matches.read(write())
    for read, written in zip(matches.pairs, (REFERENCE, DEFORMED), strict=True):
        np.testing.assert_array_equal(read, written.astype(np.float32))
        assert read.dtype == np.float64
    np.testing.assert_array_equal(matches.features, FEATURES)
    assert matches.image_size == (240, 340)
    assert matches.matching == Matching(ratio=0.7)
    assert matches.summary == {"matches": 9}


def test_arrays_of_matches_have_axes_and_units():
    assert layouts(write()) == {
        "reference": ("match component", "px"),
        "deformed": ("match component", "px"),
        "features": ("feature component", "px"),
    }
