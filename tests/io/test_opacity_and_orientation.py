"""Pixels that do not count, and which way up the others do."""

import struct
from contextlib import suppress
from io import BytesIO

import cv2
import numpy as np
import pytest
from PIL import Image

from dicflow.errors import InputError
from dicflow.io.images import orientation_sentence, probe, read_grey, read_photograph, turned_upright, upright_size
from dicflow.io.region import read_mask
from dicflow.stages.images import Images
from tests.io.photograph_files import bitmap, png, tiff_of_samples

RNG = np.random.default_rng(8)
GREY = RNG.integers(20, 230, (24, 32), dtype=np.uint8)
SEEN = np.zeros(GREY.shape, bool)
SEEN[4:20, 6:30] = True


def opaque(dtype=np.uint8, seen=255):
    """Opacity, ``seen`` in the middle and 0 around it."""
    return np.where(SEEN, seen, 0).astype(dtype)


def saved(path, image, **options):
    image.save(path, **options)
    return path


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("mode", ["LA", "RGBA"])
@pytest.mark.parametrize("opacity", [1, 128, 255])
def test_transparent_pixels_do_not_count_and_translucent_ones_do(tmp_path, suffix, mode, opacity):
    samples = [GREY] * (1 if mode == "LA" else 3) + [opaque(seen=opacity)]
    path = saved(tmp_path / f"a{suffix}", Image.fromarray(np.dstack(samples), mode))
    found = read_photograph(path)
    np.testing.assert_array_equal(found.counts, SEEN)
    np.testing.assert_array_equal(found.grey[SEEN], GREY[SEEN])
    assert np.unique(found.grey[~SEEN]).tolist() == [round(GREY[SEEN].mean())]


@pytest.mark.parametrize("colour", [4, 6])
def test_opacity_in_16_bits(tmp_path, colour):
    levels = GREY.astype(np.uint16) * 257
    path = tmp_path / "a.png"
    path.write_bytes(png(np.dstack([levels] * (1 if colour == 4 else 3) + [opaque(np.uint16, 65535)]), colour))
    found = read_photograph(path)
    np.testing.assert_array_equal(found.counts, SEEN)
    np.testing.assert_array_equal(found.grey[SEEN], levels[SEEN])


@pytest.mark.parametrize("depth", [8, 16])
def test_a_transparent_grey_level_of_a_png(tmp_path, depth):
    levels = np.where(SEEN, GREY, 7).astype(np.uint8 if depth == 8 else np.uint16)
    path = tmp_path / "a.png"
    if depth == 8:
        saved(path, Image.fromarray(levels), transparency=7)
    else:
        path.write_bytes(png(levels, 0, struct.pack(">H", 7)))
    np.testing.assert_array_equal(read_photograph(path).counts, SEEN)


def test_a_transparent_colour_of_a_palette(tmp_path):
    image = Image.fromarray(np.where(SEEN, GREY, 7).astype(np.uint8)).convert("P")
    path = saved(tmp_path / "a.png", image, transparency=7)
    np.testing.assert_array_equal(read_photograph(path).counts, SEEN)


def test_opacity_in_a_tiff_of_16_bits(tmp_path):
    levels = GREY.astype(np.uint16) * 257
    path = tmp_path / "a.tif"
    cv2.imwrite(str(path), np.dstack([levels] * 3 + [opaque(np.uint16, 65535)]))
    found = read_photograph(path)
    np.testing.assert_array_equal(found.counts, SEEN)
    np.testing.assert_array_equal(found.grey[SEEN], levels[SEEN])


def test_opaque_photographs_have_no_mask(tmp_path):
    path = saved(tmp_path / "a.png", Image.fromarray(np.dstack([GREY, np.full_like(GREY, 255)]), "LA"))
    assert read_photograph(path).counts is None
    assert set(Images(left="a.png").run(left=path).variables) == {"left"}


def test_a_photograph_without_any_opacity_is_refused(tmp_path):
    path = saved(tmp_path / "a.png", Image.fromarray(np.dstack([GREY, 0 * GREY]), "LA"))
    with pytest.raises(InputError, match=r"a\.png: transparent everywhere"):
        probe(path)


def test_the_product_has_the_mask_of_each_side(tmp_path):
    left = saved(tmp_path / "l.png", Image.fromarray(np.dstack([GREY, opaque()]), "LA"))
    right = saved(tmp_path / "r.png", Image.fromarray(GREY))
    product = Images(left="l.png", right="r.png").run(left=left, right=right)
    np.testing.assert_array_equal(product["left_counts"], SEEN)
    assert "right_counts" not in product


def test_a_mask_file_is_black_where_it_is_transparent(tmp_path):
    white = np.full_like(GREY, 255)
    path = saved(tmp_path / "mask.png", Image.fromarray(np.dstack([white, opaque()]), "LA"))
    np.testing.assert_array_equal(read_mask(path), SEEN)


# orientation


def tagged(path, tag):
    exif = Image.Exif()
    exif[0x0112] = tag
    options = {"tiffinfo": {274: tag}} if path.suffix == ".tif" else {"exif": exif}
    return saved(path, Image.fromarray(GREY), **options)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".jpg"])
@pytest.mark.parametrize("tag", range(1, 9))
def test_the_tag_is_found_and_not_applied_in_every_format(tmp_path, suffix, tag):
    plain, path = tagged(tmp_path / f"plain{suffix}", 1), tagged(tmp_path / f"a{suffix}", tag)
    assert probe(path)["orientation"] == tag
    np.testing.assert_array_equal(read_grey(path), read_grey(plain))


def test_the_tag_in_xmp_is_found(tmp_path):
    xmp = b'<x:xmpmeta><rdf:Description tiff:Orientation="6"/></x:xmpmeta>'
    assert probe(saved(tmp_path / "a.jpg", Image.fromarray(GREY), xmp=xmp))["orientation"] == 6


def test_the_tag_in_exif_counts_before_that_in_xmp(tmp_path):
    """A program that turns a photograph may renew the one and forget the other."""
    xmp = b'<x:xmpmeta><rdf:Description tiff:Orientation="6"/></x:xmpmeta>'
    exif = Image.Exif()
    exif[0x0112] = 1
    assert probe(saved(tmp_path / "a.jpg", Image.fromarray(GREY), exif=exif, xmp=xmp))["orientation"] == 1


def test_damaged_metadata_count_as_none(tmp_path):
    path = tagged(tmp_path / "a.jpg", 6)
    path.write_bytes(path.read_bytes().replace(b"Exif\0\0MM\0*", b"Exif\0\0XX\0*"))
    assert probe(path)["orientation"] == 1


@pytest.mark.parametrize("tag", range(1, 9))
def test_upright_is_what_pillow_shows(tmp_path, tag):
    from PIL import ImageOps

    path = tagged(tmp_path / "a.png", tag)
    shown = np.asarray(ImageOps.exif_transpose(Image.open(path)))
    found = Images(left="a.png", orientation="upright").run(left=path)["left"]
    np.testing.assert_array_equal(found, shown)
    assert upright_size(tag, 32, 24) == shown.shape[::-1]


@pytest.mark.parametrize("tag", range(2, 9))
def test_the_sentence_gives_the_sensor_s_place_of_a_viewer_s_pixel(tag):
    shown = turned_upright(GREY, tag)
    sentence = orientation_sentence(tag, 32, 24, upright=False)
    x, y = sentence.split("the viewer's pixel (x, y) is (")[1].split(") here")[0].replace("−", "-").split(", ")
    for row, col in ((0, 0), (5, 3), (20, 17)):
        here = {"x": col, "y": row}
        assert GREY[eval(y, {}, here), eval(x, {}, here)] == shown[row, col]


def test_the_product_says_which_way_up_it_is(tmp_path):
    path = tagged(tmp_path / "a.jpg", 6)
    assert "turned by 90° clockwise" in Images(left="a.jpg").run(left=path).attrs["notes"]["left"]
    assert "as a viewer shows them" in Images(left="a.jpg", orientation="upright").run(left=path).attrs["notes"]["left"]
    assert "notes" not in Images(left="a.jpg").run(left=tagged(path, 1)).attrs


def agree(folder, **options):
    node = Images(left="l/*", right="r/*" if (folder / "r").exists() else None, **options)
    steps = node.steps(folder)
    node.agree({file: node.check(file) for files in steps.values() for file in files.values()}, steps, {})


def test_mixed_tags_need_a_word(tmp_path):
    (tmp_path / "l").mkdir()
    for k, tag in enumerate([1, 1, 3]):
        tagged(tmp_path / "l" / f"{k}.tif", tag)
    with pytest.raises(InputError, match=r"2\.tif: tagged as rotated .*orientation: sensor.* orientation: upright"):
        agree(tmp_path)
    agree(tmp_path, orientation="sensor")
    agree(tmp_path, orientation="upright")
    tagged(tmp_path / "l" / "2.tif", 6)
    agree(tmp_path, orientation="sensor")
    with pytest.raises(InputError, match=r"2\.tif: 24 × 32 px at 8 bit, but 0\.tif has 32 × 24 px"):
        agree(tmp_path, orientation="upright")


def test_each_camera_has_a_size_of_its_own(tmp_path):
    for side, size in (("l", (32, 24)), ("r", (20, 16))):
        (tmp_path / side).mkdir()
        for k in range(3):
            Image.fromarray(GREY[: size[1], : size[0]]).save(tmp_path / side / f"{k}.png")
    agree(tmp_path)
    Image.fromarray(GREY[:12, :20]).save(tmp_path / "r" / "2.png")
    with pytest.raises(InputError, match=r"r.2\.png: 20 × 12 px at 8 bit, but 0\.png has 20 × 16 px"):
        agree(tmp_path)


def test_cameras_of_different_depth_are_refused(tmp_path):
    for side, dtype in (("l", np.uint8), ("r", np.uint16)):
        (tmp_path / side).mkdir()
        Image.fromarray(GREY.astype(dtype)).save(tmp_path / side / "0.png")
    with pytest.raises(InputError, match=r"at 16 bit, but .* at 8 bit; both cameras must have one depth"):
        agree(tmp_path)


def test_libraries_print_nothing_about_a_damaged_file(tmp_path, capfd):
    rgb = Image.fromarray(np.dstack([GREY] * 3))
    for name, options in {"a.png": {}, "b.jpg": {}, "c.tif": {"compression": "tiff_lzw"}}.items():
        buffer = BytesIO()
        rgb.save(buffer, {"png": "PNG", "jpg": "JPEG", "tif": "TIFF"}[name[2:]], **options)
        content = bytearray(buffer.getvalue())
        content[len(content) // 2 : len(content) // 2 + 40] = bytes(40)
        (tmp_path / name).write_bytes(content)
        with suppress(InputError):
            probe(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def test_opacity_of_a_bitmap_counts_unless_it_is_0_everywhere(tmp_path):
    path = tmp_path / "a.bmp"
    path.write_bytes(bitmap(GREY, opaque()))
    np.testing.assert_array_equal(read_photograph(path).counts, SEEN)
    path.write_bytes(bitmap(GREY, 0 * GREY))
    assert read_photograph(path).counts is None


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(("extra", "hides"), [(None, True), (0, False), (1, True), (2, True)])
def test_the_fourth_sample_of_a_tiff(tmp_path, planar, dtype, extra, hides):
    """Opacity, unless the file says that its meaning is unknown; grey levels do not depend on it."""
    levels = GREY.astype(dtype) * (257 if dtype is np.uint16 else 1)
    path = tmp_path / "a.tif"
    opacity = opaque(dtype, np.iinfo(dtype).max)
    path.write_bytes(tiff_of_samples(np.dstack([levels] * 3 + [opacity]), extra, planar))
    found = read_photograph(path)
    assert (found.counts is not None) == hides
    np.testing.assert_allclose(found.grey[SEEN], levels[SEEN], rtol=0, atol=1)


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_colour_in_planes_is_weighted_as_colour_in_pixels(tmp_path, planar, dtype):
    colour = RNG.integers(0, 255, (24, 32, 3)).astype(dtype) * (257 if dtype is np.uint16 else 1)
    path = tmp_path / "a.tif"
    path.write_bytes(tiff_of_samples(colour, planar=planar))
    expected = colour @ np.array([0.299, 0.587, 0.114])
    np.testing.assert_allclose(read_grey(path), expected, rtol=0, atol=1 if dtype is np.uint8 else 2)


def test_grey_of_16_bits_with_opacity_in_a_tiff_is_refused_with_the_remedy(tmp_path):
    path = tmp_path / "a.tif"
    path.write_bytes(tiff_of_samples(np.dstack([GREY, opaque()]).astype(np.uint16), 2))
    with pytest.raises(InputError, match=r"a\.tif: grey levels of 16 bits with a second value each; save it as PNG"):
        probe(path)
