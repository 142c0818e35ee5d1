"""When photographs were taken, by their EXIF metadata."""

import os
from datetime import UTC, datetime

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin

from dicflow.io.images import camera_model, time_taken, utc_offset_of

GREY = np.random.default_rng(5).integers(20, 230, (24, 32), dtype=np.uint8)
NOON = datetime(2026, 3, 1, 12, 0, 5, tzinfo=UTC).timestamp()
MAKER, MODEL, EXIF, TIME, FRACTION, OFFSET = 271, 272, 0x8769, 36867, 37521, 36881


def photograph(path, **settings):
    """A photograph with the camera's settings: its tags by their names here."""
    numbers = {"time": TIME, "fraction": FRACTION, "offset": OFFSET}
    exif = Image.Exif()
    exif[MAKER] = "a camera"  # without a tag of its own Pillow writes none of the others
    exif.get_ifd(EXIF).update({numbers[name]: value for name, value in settings.items()})
    if path.suffix == ".tif":
        tags = TiffImagePlugin.ImageFileDirectory_v2()
        tags[EXIF] = exif.get_ifd(EXIF)
        Image.fromarray(GREY).save(path, tiffinfo=tags)
    else:
        Image.fromarray(GREY).save(path, exif=exif)
    return path


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.tif"])
@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"time": "2026:03:01 12:00:05"}, NOON),
        ({"time": "2026:03:01 12:00:05", "fraction": "25"}, NOON + 0.25),
        ({"time": "2026:03:01 12:00:05", "fraction": "037 "}, NOON + 0.037),
        ({"time": "2026:03:01 13:30:05", "fraction": "5", "offset": "+01:30"}, NOON + 0.5),
        ({"time": "2026:03:01 07:00:05", "offset": "-05:00"}, NOON),
        ({"time": "2026-03-01T12:00:05", "fraction": "many", "offset": "Z"}, NOON),
        ({"fraction": "25"}, None),
        ({"time": "0000:00:00 00:00:00"}, None),
        ({"time": "0001:01:01 00:00:00", "offset": "+99:00"}, None),
        ({"time": "yesterday"}, None),
        ({}, None),
    ],
)
def test_moment_fraction_and_offset(tmp_path, name, settings, expected):
    found = time_taken(photograph(tmp_path / name, **settings))
    assert found == (expected if expected is None else pytest.approx(expected, abs=1e-6))


@pytest.mark.parametrize(("offset", "seconds"), [("+01:30", 5400.0), ("-05:00", -18000.0), ("Z", 0.0), ("", None)])
def test_what_the_clock_shows_more_than_utc(tmp_path, offset, seconds):
    path = photograph(tmp_path / "a.jpg", time="2026:03:01 12:00:05", offset=offset)
    assert utc_offset_of(path) == seconds
    assert utc_offset_of(path, in_names=True) is None
    assert utc_offset_of(path, table={"a.jpg": 1.0}) is None


def test_files_without_a_time(tmp_path):
    bitmap, text, empty = tmp_path / "a.bmp", tmp_path / "a.jpg", tmp_path / "b.png"
    Image.fromarray(GREY).save(bitmap)
    text.write_text("2026:03:01 12:00:05")
    empty.write_bytes(b"")
    pipe = tmp_path / "pipe.jpg"
    os.mkfifo(pipe)
    for path in (bitmap, text, empty, pipe, tmp_path, tmp_path / "missing.jpg"):
        assert time_taken(path) is None


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.tif"])
def test_damaged_metadata_give_a_time_or_none(tmp_path, name):
    whole = photograph(tmp_path / name, time="2026:03:01 12:00:05", fraction="25", offset="+00:00").read_bytes()
    rng, path = np.random.default_rng(3), tmp_path / f"damaged_{name}"
    for length in rng.integers(1, len(whole), 40):
        path.write_bytes(whole[:length])
        assert time_taken(path) in (None, NOON, NOON + 0.25)
    for _ in range(100):
        data = bytearray(whole)
        for place in rng.integers(8, min(len(data), 400), 3):
            data[place] = rng.integers(256)
        path.write_bytes(data)
        assert time_taken(path) is None or isinstance(time_taken(path), float)


@pytest.mark.parametrize(
    ("make", "model", "expected"),
    [
        ("Apple", "iPhone 12", "Apple iPhone 12"),
        ("NIKON CORPORATION", "NIKON D3500", "NIKON CORPORATION NIKON D3500"),
        ("Canon", "Canon EOS 90D", "Canon EOS 90D"),
        ("", "Pixel 7", "Pixel 7"),
        ("", "", ""),
    ],
)
def test_make_and_model_of_the_camera(tmp_path, make, model, expected):
    exif = Image.Exif()
    exif[MAKER], exif[MODEL] = make, model
    Image.fromarray(GREY).save(tmp_path / "a.jpg", exif=exif)
    assert camera_model(tmp_path / "a.jpg") == expected
    assert camera_model(tmp_path / "missing.jpg") == ""
