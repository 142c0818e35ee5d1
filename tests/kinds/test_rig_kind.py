import numpy as np
import pytest

from dicflow.core.cameras.camera import Camera, Rig, camera_matrix, rotation_matrix
from dicflow.core.cameras.rig_parameters import PARAMETERS
from dicflow.kinds.rig import CalibratedRig, rig_from_json, rig_to_json
from tests.kinds.layouts import stored

LEFT = Camera(camera_matrix(2400.1, (720.3, 960.7)), np.array([-0.1, 0.05, 1e-4, -2e-4, 0.0]), (1440, 1920))
RIGHT = LEFT._replace(matrix=camera_matrix(2390.7, (715.0, 955.5)))
RIG = Rig(LEFT, RIGHT, rotation_matrix([0.01, 0.2, -0.003]), np.array([-101.3, 0.4, 7.9]))
COVARIANCE = np.diag(np.random.default_rng(8).uniform(1e-6, 1e-2, len(PARAMETERS)))
PAIRS = [{"name": "01", "used": True, "left_px": 0.1}, {"name": "02", "used": False}]


def assert_equal(one: Rig, other: Rig) -> None:
    for a, b in ((one.left, other.left), (one.right, other.right)):
        np.testing.assert_array_equal(a.matrix, b.matrix)
        np.testing.assert_array_equal(a.distortion, b.distortion)
        assert a.size == b.size
    np.testing.assert_array_equal(one.rotation, other.rotation)
    np.testing.assert_array_equal(one.translation, other.translation)


def test_a_calibrated_rig_comes_back_bit_for_bit():
    coverage = {"left": 0.8, "right": 0.7}
    written = CalibratedRig.write(
        RIG, "good: 0.02 px", {"rms_px": 0.02}, covariance=COVARIANCE, pairs=PAIRS, coverage=coverage
    )
    rig = CalibratedRig.read(stored(written))
    assert_equal(rig.cameras, RIG)
    np.testing.assert_array_equal(rig.covariance, COVARIANCE)
    assert (list(rig.pairs), rig.coverage, rig.summary) == (PAIRS, coverage, {"rms_px": 0.02})
    assert (rig.verdict, rig.program, rig.warnings) == ("good: 0.02 px", "", ())
    assert rig.product.attrs["parameters"] == list(PARAMETERS)


def test_a_rig_from_a_file_has_its_program_and_warnings_and_may_lack_a_covariance():
    rig = CalibratedRig.read(stored(CalibratedRig.write(RIG, "read", {}, program="OpenCV", warnings=["no size"])))
    assert (rig.program, rig.warnings) == ("OpenCV", ("no size",))
    assert rig.covariance is None
    assert (rig.pairs, rig.coverage) == ((), {})


@pytest.mark.parametrize(("verdict", "doubtful"), [("poor: 2 px", True), ("usable: 0.3 px", True), ("good", False)])
def test_poor_and_usable_calibrations_are_doubtful(verdict, doubtful):
    assert CalibratedRig.read(CalibratedRig.write(RIG, verdict, {})).is_doubtful is doubtful


@pytest.mark.parametrize("wrong", [[0.0, 1.0], [0.0, 1.0, float("nan")]])
def test_a_translation_that_is_not_three_finite_numbers_is_refused_by_name(wrong):
    with pytest.raises(ValueError, match="translation_mm"):
        rig_from_json({**rig_to_json(RIG), "translation_mm": wrong})
