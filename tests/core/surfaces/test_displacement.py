import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import contains, rectangle
from dicflow.core.status import Status
from dicflow.core.surfaces.displacement import (
    Cloud,
    bilinear,
    material_increment,
    resize,
    resize_codes,
    thesis_increment,
)

ROW, COL = np.mgrid[:40, :30].astype(float)


def flat_cloud(z=500.0, scale=0.1, shape=(120, 100), origin=(0.0, 0.0), tilt=0.0):
    """A plane that a camera sees at 0.1 mm per px."""
    row, col = np.mgrid[: shape[0], : shape[1]].astype(float)
    x, y = scale * (col + origin[0]), scale * (row + origin[1])
    return Cloud(np.stack([x, y, z + tilt * x], axis=-1), np.zeros(shape, np.uint8), origin)


@given(x=st.floats(0, 29), y=st.floats(0, 39))
def test_perfect_bilinear_surface(x, y):
    field = np.stack([3 + 0.5 * COL - 0.2 * ROW + 0.01 * COL * ROW, COL], axis=-1)
    value = bilinear(field.astype(np.float32), np.array([x + 7.0, y - 2.0]), (7.0, -2.0))
    assert value == pytest.approx([3 + 0.5 * x - 0.2 * y + 0.01 * x * y, x], abs=2e-6)


def test_outside_is_missing():
    places = np.array([[-0.01, 5.0], [29.01, 5.0], [5.0, 39.01], [np.nan, 5.0], [29.0, 39.0]])
    assert np.isnan(bilinear(COL[..., None], places)).ravel().tolist() == [True, True, True, True, False]


def test_a_missing_neighbour_counts_only_with_weight():
    field = COL[..., None].copy()
    field[10, 11] = np.nan
    values = bilinear(field, np.array([[10.0, 10.0], [10.01, 10.0], [11.0, 9.0], [11.0, 9.01]])).ravel()
    assert values[0] == 10.0
    assert np.isnan(values[1])
    assert values[2] == 11.0
    assert np.isnan(values[3])


def test_error_of_interpolation_has_second_order():
    errors = []
    for fine in (1, 2):
        wave = np.sin(np.arange(60 * fine) / (10.0 * fine))[None, :, None] * np.ones((2, 1, 1))
        places = np.stack([np.arange(10 * fine, 50 * fine) + 0.5, np.full(40 * fine, 0.5)], axis=-1)
        errors.append(np.abs(bilinear(wave, places)[:, 0] - np.sin(places[:, 0] / (10.0 * fine))).max())
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


def test_resize_maps_borders_on_borders():
    field = (COL + 0.5)[..., None]
    assert np.allclose(resize(field, (80, 60))[0, 1:-1, 0], (np.arange(60) + 0.5)[1:-1] / 2)
    assert np.array_equal(resize(field, (40, 30)), field)


def test_a_field_with_a_border_keeps_its_size_when_stretched_often():
    field = np.where(np.hypot(COL - 15, ROW - 20) < 10, 1.0, np.nan)[..., None]
    again = field
    for shape in [(43, 31), (47, 32), (53, 31), (47, 30), (40, 30)] * 4:
        again = resize(again, shape)
    assert np.isfinite(again).sum() == pytest.approx(np.isfinite(field).sum(), rel=0.05)
    assert np.allclose(again[np.isfinite(again)], 1.0)


def test_codes_are_stretched_without_mixing():
    codes = np.array([[0, 8], [2, 1]], np.uint8)
    assert resize_codes(codes, (4, 2)).tolist() == [[0, 8], [0, 8], [2, 1], [2, 1]]


@given(shift=st.tuples(*[st.floats(-20.0, 20.0)] * 3))
@settings(max_examples=20)
def test_perfect_rigid_shift_of_material_points(shift):
    before = np.stack([20 + 2 * COL, 20 + 2 * ROW], axis=-1)
    cloud_before = flat_cloud(tilt=0.2)
    cloud = cloud_before._replace(xyz=cloud_before.xyz + shift)
    result = material_increment(before, before, np.zeros(ROW.shape, np.uint8), cloud_before, cloud)
    assert np.abs(result.displacement - shift).max() < 1e-9
    assert np.abs(result.xyz - result.xyz_reference - result.displacement).max() < 1e-12
    assert not result.status.any()


def test_status_of_material_points():
    before = np.stack([20 + 2 * COL, 20 + 2 * ROW], axis=-1)
    after, status = before + 1.5, np.zeros(ROW.shape, np.uint8)
    after[3, 4], status[3, 4] = np.nan, Status.UNTRACKED
    after[5, 6] = 4000.0
    status[7, 8] = Status.FILLED
    cloud = flat_cloud()
    cloud.status[32, 42], cloud.xyz[32, 42] = Status.NO_MATCH, np.nan
    cloud.status[60:70, 60:70] = Status.FILLED
    result = material_increment(before, after, status, flat_cloud(), cloud)
    assert result.status[3, 4] == Status.UNTRACKED
    assert result.status[5, 6] == Status.OUTSIDE
    assert result.status[7, 8] == Status.FILLED
    assert result.status[20, 20] == Status.FILLED
    assert result.status[5, 10] == Status.NO_MATCH
    missing = np.isnan(result.displacement).any(axis=-1)
    assert np.array_equal(missing, result.status > Status.FILLED)
    assert np.isnan(result.xy[missing]).all()


def test_one_camera_measures_in_pixels():
    before = np.stack([COL, ROW], axis=-1)
    result = material_increment(before, before + np.array([0.25, -3.0]), np.zeros(ROW.shape, np.uint8))
    assert np.allclose(result.displacement, [0.25, -3.0, 0.0])
    assert np.all(result.xyz[..., 2] == 0.0)


def stretch(factor, centre=(50.0, 20.0)):
    """Transform that stretches y about the centre."""
    return np.array([[1.0, 0, 0], [0, factor, centre[1] * (1 - factor)], [0, 0, 1]])


def test_perfect_thesis_increment_of_a_stretch():
    """dy = 0.1 mm/px · (y − 20) (f − 1) / f at the deformed y, to the rounding of the grid: 1.5 px · (f − 1) / f."""
    factor = 1.25
    before, after = rectangle(20, 20, 80, 80), rectangle(20, 20, 80, 95)
    transforms = np.broadcast_to(stretch(factor), (3, 3, 3, 3))
    result = thesis_increment(transforms, [before], [after], flat_cloud(), flat_cloud())
    inside = contains([after], result.xy)
    truth = 0.1 * (result.xy[..., 1] - 20) * (factor - 1) / factor
    error = (result.displacement[..., 1] - truth)[inside]
    measured = result.status[inside] == Status.VALID
    assert np.abs(error[measured]).max() < 0.1 * 1.5 * (factor - 1) / factor + 1e-9
    assert np.isfinite(error).all()
    assert np.abs(result.displacement[inside][:, 0]).max() < 1e-9
    assert measured.mean() == pytest.approx(1 / factor, abs=0.03)
    assert np.all(result.status[~inside] == Status.OUTSIDE)
    assert np.allclose(result.xyz_reference[inside][:, 1], 2.0 + 0.1 * (result.xy[inside][:, 1] - 20) * 60 / 75)


def test_thesis_components_both_hold_the_depth():
    """dx = ±√(Δx² + Δz²), dy = ±√(Δy² + Δz²)."""
    box = rectangle(20, 20, 80, 80)
    cloud = flat_cloud()
    moved = cloud._replace(xyz=cloud.xyz + np.array([-0.3, 0.5, 1.2]))
    result = thesis_increment(np.broadcast_to(np.eye(3), (2, 2, 3, 3)), [box], [box], cloud, moved)
    known = np.isfinite(result.displacement[..., 0])
    assert np.allclose(result.displacement[known], [-np.hypot(0.3, 1.2), np.hypot(0.5, 1.2), 1.2])


def test_thesis_increment_of_one_camera_and_a_lost_subset():
    box = rectangle(20, 20, 80, 80)
    transforms = np.tile(stretch(1.0), (2, 2, 1, 1))
    transforms[..., 0, 2], transforms[..., 1, 2] = 3.0, -6.0
    transforms[0, 0] = np.nan
    result = thesis_increment(transforms, [box], [Polygon(box.exterior + np.array([3.0, -6.0]))])
    known = np.isfinite(result.displacement[..., 0])
    assert np.allclose(result.displacement[known], [3.0, -6.0, 0.0])
    filled = result.status == Status.FILLED
    assert filled[1:8, 1:8].all()
    assert np.all(result.status[10:, 10:] == Status.VALID)


def test_thesis_increment_leaves_the_opening_out():
    box = Polygon(rectangle(20, 20, 80, 80).exterior, (rectangle(40, 40, 60, 60).exterior,))
    result = thesis_increment(np.broadcast_to(np.eye(3), (3, 3, 3, 3)), [box], [box], flat_cloud(), flat_cloud())
    in_hole = contains([rectangle(40, 40, 60, 60)], result.xy)
    assert np.isnan(result.displacement[in_hole]).all()
    assert np.all(result.status[in_hole] == Status.OUTSIDE)
