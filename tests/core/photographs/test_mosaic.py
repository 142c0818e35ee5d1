"""Raw mosaics, and photographs that look a little like one."""

import cv2
import numpy as np
import pytest

from dicflow.core.photographs.mosaic import MIN_CONTRAST, colour_filters, filter_contrast

ROWS, COLS = 300, 400
ROW, COL = np.mgrid[:ROWS, :COLS]


def speckles(size_px=3.0, seed=1):
    """Grey levels 40 … 210 of speckles."""
    field = np.random.default_rng(seed).standard_normal((ROWS, COLS))
    field = cv2.GaussianBlur(field, (0, 0), size_px / 2.5) if size_px > 1 else field
    return 40 + 170 / (1 + np.exp(-3 * field / field.std()))


def through_filters(scene, red=0.55, blue=0.7, first="R"):
    """The scene (row, col) or, in colour, (row, col, 3) behind a mosaic whose first pixel has the given colour."""
    colour = scene if scene.ndim == 3 else np.dstack([red * scene, scene, blue * scene])
    row, col = {"R": (0, 0), "G": (0, 1), "g": (1, 0), "B": (1, 1)}[first]
    is_red = ((ROW + row) % 2 == 0) & ((COL + col) % 2 == 0)
    is_blue = ((ROW + row) % 2 == 1) & ((COL + col) % 2 == 1)
    return np.where(is_red, colour[..., 0], np.where(is_blue, colour[..., 2], colour[..., 1]))


def digitised(levels, bits=8, noise=1.5, seed=0):
    scale = 1 if bits == 8 else 257
    noisy = levels + np.random.default_rng(seed).normal(0, noise, levels.shape)
    return np.clip(np.round(noisy * scale), 0, 255 * scale).astype(np.uint8 if bits == 8 else np.uint16)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize(
    ("first", "arrangement"),
    [("R", "RGGB or BGGR"), ("B", "RGGB or BGGR"), ("G", "GRBG or GBRG"), ("g", "GRBG or GBRG")],
)
@pytest.mark.parametrize("size_px", [2.0, 3.0, 8.0, 20.0])
def test_a_mosaic_is_recognised_with_its_arrangement(first, arrangement, bits, size_px):
    assert colour_filters(digitised(through_filters(speckles(size_px), first=first), bits)) == arrangement


@pytest.mark.parametrize(("red", "blue"), [(0.9, 0.8), (0.5, 0.4), (1.3, 0.8), (0.3, 0.9), (0.6, 0.6)])
def test_the_contrast_is_that_of_the_filters(red, blue):
    found = filter_contrast(digitised(through_filters(speckles(), red, blue), 16), 0)
    assert found == pytest.approx(min(abs(np.log(red)), abs(np.log(blue))), abs=0.02)


@pytest.mark.parametrize("background", [2.0, 25.0, 120.0])
@pytest.mark.parametrize("share", [0.3, 0.6])
def test_a_specimen_in_front_of_an_even_background(background, share):
    scene = np.where(share * COLS > COL, speckles(), background)
    assert colour_filters(digitised(through_filters(scene))) == "RGGB or BGGR"
    assert colour_filters(digitised(scene)) is None


def halftone(pitch_px, angle_deg=0.0):
    """Dots in a square lattice whose size follows a smooth picture, as an inkjet prints it."""
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    x, y = (c * COL + s * ROW) / pitch_px, (-s * COL + c * ROW) / pitch_px
    screen = np.cos(2 * np.pi * x) + np.cos(2 * np.pi * y)
    return np.where(screen > 1.2 * np.sin(COL / 60) * np.cos(ROW / 45), 60, 200)


def board(square_px):
    return np.where((ROW // square_px + COL // square_px) % 2, 200, 50)


ORDINARY = {
    **{f"speckles of {size:g} px": speckles(size) for size in (1.0, 1.5, 2.0, 3.0, 5.0)},
    **{f"halftone of {pitch:g} px": halftone(pitch) for pitch in (2, 2.1, 3, 4, 5, 6, 8, 10)},
    **{f"turned halftone of {pitch:g} px": halftone(pitch, 30) for pitch in (2.83, 4, 6)},
    **{f"board of {side} px": board(side) for side in (1, 2, 3, 4, 5, 6, 25, 40)},
    "stripes of columns": speckles() * (1 - 0.2 * (COL % 2)),
    "stripes of rows": speckles() * (1 - 0.2 * (ROW % 2)),
    "stripes of both": speckles() * (1 - 0.2 * (ROW % 2)) * (1 - 0.1 * (COL % 2)),
    "ramp": 20 + COL / 2,
    "dark": np.full((ROWS, COLS), 3.0),
    "black": np.zeros((ROWS, COLS)),
    "balanced mosaic of a grey specimen": through_filters(speckles(), 1.0, 1.0),
}


@pytest.mark.parametrize("name", ORDINARY)
@pytest.mark.parametrize("noise", [0.0, 1.5, 8.0])
def test_other_photographs_are_not_taken_for_a_mosaic(name, noise):
    assert colour_filters(digitised(ORDINARY[name], noise=noise)) is None


@pytest.mark.parametrize("quality", [30, 60, 95])
def test_blocks_of_jpeg_are_not_taken_for_a_mosaic(quality):
    packed = cv2.imencode(".jpg", digitised(speckles()), [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    grey = cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE)
    assert max(filter_contrast(grey, k) for k in (0, 1)) < MIN_CONTRAST / 10


def test_a_colour_photograph_turned_to_grey_is_not_a_mosaic():
    scene = np.dstack([speckles(seed=1), speckles(seed=2), speckles(seed=3)])
    assert colour_filters(digitised(scene @ [0.299, 0.587, 0.114])) is None


def test_a_small_picture_says_nothing():
    assert colour_filters(np.zeros((3, 4), np.uint8)) is None
    assert colour_filters(digitised(through_filters(speckles())[:64, :64])) is None
