import numpy as np

from dicflow.kinds.cloud import Cloud
from tests.kinds.layouts import layouts, long_names, stored

XYZ = np.random.default_rng(5).normal(size=(3, 4, 3))
XYZ[0, 0] = np.nan
STATUS = np.where(np.isnan(XYZ[..., 0]), 4, 0).astype(np.uint8)


def write(**options):
    return stored(Cloud.write(XYZ, STATUS, (30, 40), {"valid_share": 11 / 12}, **options))


def test_points_are_kept_in_single_precision():
    cloud = Cloud.read(write())
    np.testing.assert_array_equal(cloud["xyz"], XYZ.astype(np.float32))
    np.testing.assert_array_equal(cloud["status"], STATUS)
    assert cloud.origin == (30, 40)
    assert cloud.summary == {"valid_share": 11 / 12}


def test_core_takes_the_points_as_they_are():
    field = Cloud.read(write()).field
    np.testing.assert_array_equal(field.xyz, XYZ.astype(np.float32))
    np.testing.assert_array_equal(field.status, STATUS)
    assert field.origin == (30, 40)


def test_measured_points_have_no_fit_and_a_surface_has_one():
    fit = {"x": {"degree": [3, 3], "rmse": 0.01}}
    assert Cloud.read(write()).fit == {}
    assert "fit" not in write().attrs
    surface = Cloud.read(write(fit=fit, title="smooth surface"))
    assert surface.fit == fit
    assert surface.title == "smooth surface"


def test_arrays_of_a_cloud_have_axes_and_units():
    assert layouts(write()) == {"xyz": ("row col component", "mm"), "status": ("row col", "1")}
    assert long_names(write())["xyz"] == "position"
