"""Parts of photographs: every place is where it lies."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from dicflow.views import crops


def grid(rows=21, cols=31, pitch=7.0, corner=(100.0, 50.0)):
    row, col = np.mgrid[0:rows, 0:cols].astype(float)
    return np.stack([corner[0] + pitch * col, corner[1] + pitch * row], axis=-1)


def shown(points, longest_px=400):
    return crops.crop_around([crops.point_box(points)], (1440, 1920), longest_px)


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
    crop = crops.crop_around([(-20, -5, 3000, 3000)], (1440, 1920), 4000)
    assert crop == crops.Crop((1440, 1920), 1.0, (0, 0))
    assert crops.crop_around([], (1440, 1920), 960).size == (720, 960)


@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint16, 4095), (np.uint16, 65535)])
def test_a_photograph_of_any_depth_is_where_its_crop_is(dtype, white):
    image = np.zeros((400, 600), dtype)
    image[200:, 300:] = white
    crop = crops.crop_around([(200, 100, 400, 300)], (600, 400), 120)
    picture = cv2.imdecode(np.frombuffer(crops.photo_jpeg(image, crop), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture.shape[::-1] == crop.size
    x, y = np.rint(crop.place(np.array([300.0, 200.0]))).astype(int)
    assert picture[y + 4, x + 4] > 240
    assert max(picture[y - 4, x + 4], picture[y + 4, x - 4]) < 15
