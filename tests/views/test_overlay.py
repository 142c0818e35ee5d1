"""Small pictures that are laid over one another: every colour shows its value, every place its point."""

from __future__ import annotations

import base64
import re
from io import BytesIO

import cv2
import numpy as np
import pytest
from PIL import Image

from dicflow.core.status import Status
from dicflow.views import overlay
from dicflow.views.colours import REASON_COLOURS, look, palette

LOOK = look("exx", "Hencky strain along x", "1", 0.0, 1.0)


def grid(rows=21, cols=31, pitch=7.0, corner=(100.0, 50.0)):
    row, col = np.mgrid[0:rows, 0:cols].astype(float)
    return np.stack([corner[0] + pitch * col, corner[1] + pitch * row], axis=-1)


def rgba(content):
    return np.asarray(Image.open(BytesIO(content)).convert("RGBA"), int)


def shown(points, longest_px=400):
    return overlay.crop_around([overlay.point_box(points)], (1440, 1920), longest_px)


def nearest_levels(colours):
    table = palette("viridis").astype(int)
    return np.array([np.abs(table - colour[:3]).sum(axis=1).argmin() for colour in colours])


@pytest.mark.parametrize("longest_px", [50, 200, 5000])
def test_a_crop_holds_all_points_and_is_never_enlarged(longest_px):
    points = grid()
    crop = shown(points, longest_px)
    assert max(crop.size) <= longest_px
    assert crop.scale <= 1.0
    placed = crop.place(points)
    assert (placed >= -0.5).all()
    assert (placed <= np.array(crop.size) - 0.5).all()


def test_a_crop_ends_at_the_image():
    crop = overlay.crop_around([(-20, -5, 3000, 3000)], (1440, 1920), 4000)
    assert crop == overlay.Crop((1440, 1920), 1.0, (0, 0))
    assert overlay.crop_around([], (1440, 1920), 960).size == (720, 960)


def test_a_linear_field_has_the_colours_of_its_values():
    points = grid()
    crop = shown(points)
    values = (points[..., 0] - 100.0) / 210.0
    picture = rgba(overlay.field_png(values, overlay.cell_index(points, crop), LOOK))
    assert picture.shape[:2] == crop.size[::-1]
    centres = points[:-1, :-1] + 3.5
    x, y = np.rint(crop.place(centres.reshape(-1, 2))).astype(int).T
    expected = np.floor((centres[..., 0].ravel() - 100.0) / 210.0 * 254)
    assert (picture[y, x, 3] == 255).all()
    assert np.abs(nearest_levels(picture[y, x]) - expected).max() <= 1


def test_what_is_not_known_is_clear():
    points = grid()
    crop, values = shown(points), np.full((21, 31), 0.5)
    points[5, 5], values[15, 20] = np.nan, np.nan
    picture = rgba(overlay.field_png(values, overlay.cell_index(points, crop), LOOK))
    for row, col in ((5, 5), (15, 20)):
        x, y = np.rint(crop.place(grid()[row, col])).astype(int)
        assert (picture[y - 3 : y + 4, x - 3 : x + 4, 3] == 0).all()
    assert (picture[:5, :, 3] == 0).all()


def test_cells_fill_their_grid_without_gaps():
    points = grid()
    points[..., 0] += 0.3 * points[..., 1]
    index = overlay.cell_index(points, shown(points))
    area = np.count_nonzero(index >= 0)
    assert area == pytest.approx(210.0 * 140.0, rel=0.03)
    assert set(np.unique(index)) == {-1, *range(600)}


def test_values_beyond_the_range_have_the_colour_of_its_end():
    """Two cells, one below and one above the range, and one whose mean is unknown."""
    values = np.array([[-9.0, -9.0, 99.0, np.inf]] * 2)
    picture = rgba(overlay.field_png(values, np.array([[0, 1, 2, -1]], np.int32), LOOK))
    np.testing.assert_array_equal(picture[0, :2, :3], palette("viridis")[[0, -1]])
    assert picture[0, 2:, 3].tolist() == [0, 0]


def test_reasons_have_their_colours_and_what_is_measured_has_none():
    picture = rgba(overlay.reason_png(np.array([list(Status)], np.uint8)))[0]
    assert picture[0, 3] == 0
    for code, colour in REASON_COLOURS.items():
        assert "#" + bytes(picture[code].astype(np.uint8)[:3]).hex() == colour
        assert picture[code, 3] == 255
    assert len(set(REASON_COLOURS.values())) == len(Status) - 1


@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint16, 4095), (np.uint16, 65535)])
def test_a_photograph_of_any_depth_is_where_its_crop_is(dtype, white):
    image = np.zeros((400, 600), dtype)
    image[200:, 300:] = white
    crop = overlay.crop_around([(200, 100, 400, 300)], (600, 400), 120)
    picture = cv2.imdecode(np.frombuffer(overlay.photo_jpeg(image, crop), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture.shape[::-1] == crop.size
    x, y = np.rint(crop.place(np.array([300.0, 200.0]))).astype(int)
    assert picture[y + 4, x + 4] > 240
    assert max(picture[y - 4, x + 4], picture[y + 4, x - 4]) < 15


def test_directions_are_lines_at_their_angle():
    points = grid()
    angles = np.full(points.shape[:2], 30.0)
    angles[:10] = np.nan
    path = overlay.direction_path(points, angles, shown(points), count=100)
    lines = np.array(re.findall(r"M(\S+) (\S+)L(\S+) (\S+?)(?=M|$)", path), float)
    assert 30 <= len(lines) <= 70
    found = np.degrees(np.arctan2(lines[:, 3] - lines[:, 1], lines[:, 2] - lines[:, 0]))
    np.testing.assert_allclose(found, 30.0, atol=1.0)
    assert overlay.direction_path(points, np.full_like(angles, np.nan), shown(points)) == ""


@pytest.mark.parametrize("gradient", [[[1.3, 0.4], [-0.2, 0.9]], [[0.0, -1.0], [1.0, 0.0]]])
def test_directions_are_carried_as_the_material_is(gradient):
    """A homogeneous deformation F turns a direction d into F d, and back."""
    before, angle = grid(), 25.0
    after = before @ np.transpose(gradient)
    after[0, 0] = np.nan
    x, y = np.array(gradient) @ [np.cos(np.radians(angle)), np.sin(np.radians(angle))]
    angles = np.full(before.shape[:2], angle)
    carried = overlay.carried_angle(before, after, angles)
    known = np.isfinite(carried)
    assert known.sum() == angles.size - 3
    np.testing.assert_allclose(carried[known], np.degrees(np.arctan2(y, x)), atol=1e-9)
    np.testing.assert_allclose(overlay.carried_angle(after, before, carried)[known], angle, atol=1e-9)


def test_a_colour_bar_has_the_colours_of_the_field_its_unit_and_round_numbers():
    signed = look("eyy", "strain <along> y", "1", -0.02, 0.013)
    bar = overlay.colour_bar_svg(signed)
    assert "strain &lt;along&gt; y [–]" in bar
    assert re.findall(r">([−0-9.]+)</text>", bar) == ["−0.02", "−0.01", "0.00", "0.01", "0.02"]
    strip = rgba(base64.b64decode(re.search(r"base64,([^\"]+)", bar).group(1)))
    np.testing.assert_array_equal(strip[0, :, :3], palette("RdBu_r"))
    assert (strip[..., 3] == 255).all()


def test_equal_input_gives_equal_bytes():
    points = grid()
    index = overlay.cell_index(points, shown(points))
    values = points[..., 1] / 300
    assert overlay.field_png(values, index, LOOK) == overlay.field_png(values, index, LOOK)
    assert overlay.colour_bar_svg(LOOK) == overlay.colour_bar_svg(LOOK)
