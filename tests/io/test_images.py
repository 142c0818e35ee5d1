"""Photographs: reading, naming, pairing."""

import os
import zlib
from io import BytesIO

import cv2
import numpy as np
import pytest
from PIL import Image

from dicflow.errors import InputError
from dicflow.io.images import natural_key, page_count, pair_names, probe, read_grey
from dicflow.stages.images import Images
from tests.replaced import replace_here

RAMP = np.arange(12, dtype=np.uint8).reshape(3, 4) * 20


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp"])
def test_perfect_grey_levels_come_back(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    Image.fromarray(RAMP).save(path)
    np.testing.assert_array_equal(read_grey(path), RAMP)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_sixteen_bits_come_back(tmp_path, suffix):
    levels = RAMP.astype(np.uint16) * 200
    path = tmp_path / f"a{suffix}"
    Image.fromarray(levels).save(path)
    np.testing.assert_array_equal(read_grey(path), levels)
    assert probe(path)["bits"] == 16


def test_colour_is_weighted_to_luma(tmp_path):
    path = tmp_path / "a.png"
    Image.fromarray(np.full((2, 2, 3), (200, 100, 50), np.uint8)).save(path)
    assert abs(int(read_grey(path)[0, 0]) - (0.299 * 200 + 0.587 * 100 + 0.114 * 50)) <= 1


def test_orientation_is_reported_and_not_applied(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    path = tmp_path / "a.jpg"
    Image.fromarray(RAMP).save(path, exif=exif)
    assert probe(path) == {"width": 4, "height": 3, "bits": 8, "orientation": 6, "mosaic": None}
    assert read_grey(path).shape == (3, 4)


NOISE = np.random.default_rng(1).integers(0, 255, (64, 48), dtype=np.uint8)
COLOUR = np.random.default_rng(2).integers(0, 255, (64, 48, 3), dtype=np.uint8)
FORMATS = {
    "PNG": {},
    "PNG of 16 bits": {},
    "TIFF": {},
    "TIFF of 16 bits": {},
    "TIFF in LZW": {"compression": "tiff_lzw"},
    "TIFF in deflate": {"compression": "tiff_adobe_deflate"},
    "TIFF in PackBits": {"compression": "packbits"},
    "JPEG": {},
    "JPEG, progressive": {"progressive": True},
    "BMP": {},
}


def _file(name, levels=NOISE):
    """A photograph's file in one of the formats."""
    deep = name.endswith("16 bits")
    buffer = BytesIO()
    Image.fromarray(levels.astype(np.uint16) * 200 if deep else levels).save(
        buffer, name.split()[0].strip(","), **FORMATS[name]
    )
    return buffer.getvalue()


def _saved(folder, content):
    """The content in a file whose name does not say the format."""
    path = folder / "photograph.png"
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("name", FORMATS)
def test_check_and_stage_see_the_same_photograph(tmp_path, name):
    path = _saved(tmp_path, _file(name))
    grey = read_grey(path)
    facts = {"width": 48, "height": 64, "bits": 8 * grey.itemsize, "orientation": 1, "mosaic": None}
    assert probe(path) == facts
    scale = 200 if name.endswith("16 bits") else 1
    tolerance = 40 if "JPEG" in name else 0
    np.testing.assert_allclose(grey, NOISE.astype(int) * scale, rtol=0, atol=tolerance)


@pytest.mark.parametrize("name", [name for name in FORMATS if "16 bits" not in name])
def test_colour_is_weighted_as_opencv_does(tmp_path, name):
    path = _saved(tmp_path, _file(name, COLOUR))
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    np.testing.assert_array_equal(read_grey(path), cv2.imread(str(path), flags))


@pytest.mark.parametrize("order", ["<", ">"])
def test_both_byte_orders_of_a_tiff_give_the_same_levels(tmp_path, order):
    levels = np.random.default_rng(3).integers(0, 65535, (20, 30), dtype=np.uint16)
    path = tmp_path / "a.tif"
    Image.fromarray(levels.astype(f"{order}u2")).save(path)
    np.testing.assert_array_equal(read_grey(path), levels)


def test_colour_of_sixteen_bits_counts_as_sixteen(tmp_path):
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), COLOUR.astype(np.uint16) * 200)
    assert probe(path)["bits"] == 16
    assert read_grey(path).dtype == np.uint16


def test_a_tiff_in_which_white_is_zero_gives_the_same_levels(tmp_path):
    path = tmp_path / "a.tif"
    Image.fromarray(NOISE).save(path, tiffinfo={262: 0})  # Pillow inverts the samples with the tag
    np.testing.assert_array_equal(read_grey(path), NOISE)


@pytest.mark.filterwarnings("ignore:Corrupt EXIF data")
@pytest.mark.parametrize("reader", [probe, read_grey])
@pytest.mark.parametrize("share", [0.3, 0.9])
@pytest.mark.parametrize("name", FORMATS)
def test_a_truncated_file_is_named(tmp_path, name, share, reader):
    content = _file(name)
    path = _saved(tmp_path, content[: int(share * len(content))])
    with pytest.raises(InputError, match=r"photograph\.png: .*truncated or damaged"):
        reader(path)


def test_a_jpeg_with_a_preview_is_named_if_its_own_scan_is_cut(tmp_path):
    exif = b"Exif\0\0" + _file("JPEG", NOISE[::4, ::4])
    marked = b"\xff\xd8\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + _file("JPEG")[2:]
    assert probe(_saved(tmp_path, marked))["width"] == 48
    with pytest.raises(InputError, match=r"photograph\.png"):
        probe(_saved(tmp_path, marked[:-300]))


@pytest.mark.parametrize("name", ["TIFF in LZW", "TIFF in deflate"])
def test_damage_in_a_compressed_tiff_is_named(tmp_path, name):
    content = bytearray(_file(name))
    content[1000:1100] = bytes(100)
    with pytest.raises(InputError, match=r"photograph\.png: .*damaged"):
        read_grey(_saved(tmp_path, content))


@pytest.mark.parametrize("form", ["WEBP", "GIF", "PPM", "JPEG2000", "ICO", "TGA"])
def test_another_format_reaches_no_library(tmp_path, form, monkeypatch):
    buffer = BytesIO()
    Image.fromarray(COLOUR).save(buffer, form)
    path = _saved(tmp_path, buffer.getvalue())
    for library, function in ((Image, "open"), (cv2, "imdecode")):
        replace_here(monkeypatch, library, function, lambda *_, **__: pytest.fail("is opened"))
    with pytest.raises(InputError, match=r"photograph\.png: .*PNG, TIFF, JPEG or BMP"):
        probe(path)


BOX = bytes([0, 0, 0, 24])
FOREIGN = {
    "HEIC": BOX + b"ftypheic",
    "AVIF": BOX + b"ftypavif",
    "WebP": b"RIFF\0\0\0\0WEBP",
    "raw file": BOX + b"ftypcrx ",
    "video": BOX + b"ftypisom",
    "PostScript": b"%!PS-Adobe-3.0 EPSF-3.0\n",
    "SVG": b"<svg xmlns='http://www.w3.org/2000/svg'/>",
    "Photoshop": b"8BPS\0\1",
    "DDS": b"DDS |\0\0\0",
    "PDF": b"%PDF-1.7",
    "ZIP": b"PK\3\4",
    "Git LFS": b"version https://git-lfs.github.com/spec/v1\n",
    "text": b"load,extension\n1,2\n",
}


@pytest.mark.parametrize("name", FOREIGN)
def test_a_file_of_another_kind_is_called_by_its_name(tmp_path, name):
    path = _saved(tmp_path, FOREIGN[name] + (b"" if name == "text" else bytes(40)))
    with pytest.raises(InputError, match=rf"photograph\.png: .*{name}.*; "):
        probe(path)
    assert page_count(path) == 1


def test_an_empty_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"photograph\.png: the photograph is empty"):
        probe(_saved(tmp_path, b""))


def test_a_chunk_that_promises_gigabytes_takes_no_memory(tmp_path):
    content = bytearray(_file("PNG", COLOUR))
    place = content.index(b"IDAT") - 4
    content[place : place + 4] = (1 << 30).to_bytes(4, "big")
    with pytest.raises(InputError, match=r"photograph\.png: .*damaged"):
        probe(_saved(tmp_path, content))


@pytest.mark.parametrize("dtype", [np.int32, np.float32])
def test_other_numbers_than_grey_levels_are_refused_by_the_check(tmp_path, dtype):
    path = tmp_path / "a.tif"
    Image.fromarray(NOISE.astype(dtype)).save(path)
    with pytest.raises(InputError, match=r"a\.tif: .*8 or 16 bits"):
        probe(path)


@pytest.mark.parametrize("form", ["PNG", "JPEG", "TIFF"])
def test_the_orientation_is_found_in_every_format_that_has_it(tmp_path, form):
    exif = Image.Exif()
    exif[0x0112] = 3
    buffer = BytesIO()
    Image.fromarray(NOISE).save(buffer, form, exif=exif)
    assert probe(_saved(tmp_path, buffer.getvalue()))["orientation"] == 3


def test_the_orientation_is_found_behind_the_pixels_of_a_png(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    block = b"eXIf" + exif.tobytes()[6:]
    chunk = (len(block) - 4).to_bytes(4, "big") + block + zlib.crc32(block).to_bytes(4, "big")
    content = _file("PNG")
    assert probe(_saved(tmp_path, content[:-12] + chunk + content[-12:]))["orientation"] == 6


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"a\.png: no such file"):
        probe(tmp_path / "a.png")


def test_what_is_not_a_regular_file_is_named(tmp_path):
    os.mkfifo(tmp_path / "a.png")
    (tmp_path / "b.png").mkdir()
    for name in ("a.png", "b.png"):
        with pytest.raises(InputError, match=rf"{name}: not a regular file"):
            probe(tmp_path / name)
    assert page_count(tmp_path / "a.png") == 1


def test_names_sort_naturally():
    assert sorted(["s10.png", "s9.png", "S1.png"], key=natural_key) == ["S1.png", "s9.png", "s10.png"]


@pytest.mark.parametrize(
    ("left", "right", "by"),
    [
        (["a_2_0.tif", "a_10_0.tif"], ["a_10_1.tif", "a_2_1.tif"], "name"),
        (["ImageLeft7.jpg", "ImageLeft8.jpg"], ["ImageRight7.jpg", "ImageRight8.jpg"], "name"),
        (["before.jpg", "loaded.jpg"], ["a.jpg", "b.jpg"], "order"),
        (["only.png"], ["other.png"], "name"),
    ],
)
def test_partners(left, right, by):
    pairing = pair_names(left, right)
    assert pairing.by == by
    assert [natural_key(a) for a, _ in pairing.pairs] == sorted(natural_key(name) for name in left)
    assert [b for _, b in pairing.pairs] == sorted(right, key=natural_key)


def test_missing_partner_is_named_even_if_it_is_the_last():
    left = [f"l{i:02d}.png" for i in range(1, 11)]
    right = [f"r{i:02d}.png" for i in range(1, 10)]
    with pytest.raises(InputError, match=r"without a partner: left l10\.png"):
        pair_names(left, right)


def _series(folder, **turned):
    for side in ("left", "right"):
        (folder / side).mkdir()
        for step in range(2):
            exif = Image.Exif()
            exif[0x0112] = turned.get(side, 1)
            Image.fromarray(RAMP).save(folder / side / f"{step}.jpg", exif=exif)
    return Images(left="left/*.jpg", right="right/*.jpg")


def _agree(node, folder):
    steps = node.steps(folder)
    facts = {path: node.check(path) for files in steps.values() for path in files.values()}
    node.agree(facts, steps, {})


def test_series_agrees(tmp_path):
    node = _series(tmp_path)
    _agree(node, tmp_path)
    assert list(node.steps(tmp_path)) == ["0", "1"]


def test_rotation_on_one_side_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"right.0\.jpg.*tagged as rotated .*orientation 6"):
        _agree(_series(tmp_path, right=6), tmp_path)


def test_two_sizes_are_refused(tmp_path):
    node = _series(tmp_path)
    Image.fromarray(RAMP[:2]).save(tmp_path / "right" / "1.jpg")
    with pytest.raises(InputError, match=r"1\.jpg: 4 × 2 px at 8 bit, but 0\.jpg has 4 × 3 px"):
        _agree(node, tmp_path)


def test_a_jpeg_of_many_scans_is_refused(tmp_path):
    """Each takes a few bytes in the file, and a pass over the whole picture."""
    buffer = BytesIO()
    Image.fromarray(RAMP).save(buffer, "JPEG", progressive=True)
    data = buffer.getvalue()
    last = data[data.rfind(b"\xff\xda") : -2]
    path = tmp_path / "a.jpg"
    path.write_bytes(data[:-2] + 10 * last + data[-2:])
    assert read_grey(path).shape == RAMP.shape
    path.write_bytes(data[:-2] + 100 * last + data[-2:])
    with pytest.raises(InputError, match=r"a\.jpg: more than 100 scans"):
        read_grey(path)


def test_empty_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match="no photograph matches"):
        Images(left="*.png").steps(tmp_path)


def _files(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).touch()


@pytest.mark.parametrize("names", [("load/01.png", "unload/01.png"), ("a/01.png", "a/01.tif")])
@pytest.mark.parametrize("side", ["left", "right"])
def test_two_photographs_of_one_name_are_refused(tmp_path, names, side):
    _files(tmp_path, *names, "other/1.png", "other/2.png")
    patterns = {"left": "other/*.png", "right": "other/*.png", side: "*[!r]/*"}
    with pytest.raises(InputError, match=f"^{side}: .*{names[0]} and .*{names[1]} would both be step '01'; rename"):
        Images(**patterns).steps(tmp_path)


def test_a_list_keeps_its_order_and_a_pattern_is_sorted(tmp_path):
    _files(tmp_path, "l/9.png", "l/10.png", "l/2.png", "r/x21.png", "r/x22.png", "r/x23.png")
    assert list(Images(left="l/*.png").steps(tmp_path)) == ["2", "9", "10"]
    assert list(Images(left=["l/10.png", "l/*.png"]).steps(tmp_path)) == ["10", "2", "9"]
    steps = Images(left=["l/9.png", "l/10.png", "l/2.png"], right=["r/x23.png", "r/x21.png", "r/x22.png"]).steps(
        tmp_path
    )
    assert [(step, files["right"].name) for step, files in steps.items()] == [
        ("9", "x23.png"),
        ("10", "x21.png"),
        ("2", "x22.png"),
    ]
