"""Files of several photographs: every page is a step."""

import struct
import zlib
from io import BytesIO

import cv2
import numpy as np
import pytest
from PIL import Image

from dicflow.engine.files import FilePart
from dicflow.errors import InputError
from dicflow.io.images import page_count, probe, read_grey, read_photograph
from dicflow.stages.images import Images
from tests.io.photograph_files import tiff

PAGES = np.random.default_rng(5).integers(0, 255, (4, 24, 32), dtype=np.uint8)


def stack(path, pages=PAGES, form="TIFF", **options):
    """A file of several pages."""
    path.parent.mkdir(exist_ok=True)
    first, *others = (Image.fromarray(page) for page in pages)
    first.save(path, form, save_all=True, append_images=others, **options)
    return path


def test_each_page_is_a_step_that_is_read_alone(tmp_path):
    path = stack(tmp_path / "test.tif")
    steps = Images(left="*.tif").steps(tmp_path)
    assert list(steps) == ["test_001", "test_002", "test_003", "test_004"]
    assert steps["test_002"]["left"] == FilePart(path, 2)
    for page, files in zip(PAGES, steps.values(), strict=True):
        np.testing.assert_array_equal(read_grey(files["left"]), page)
        np.testing.assert_array_equal(Images(left="*.tif").run(**files)["left"], page)


@pytest.mark.parametrize("options", [{}, {"compression": "tiff_lzw"}, {"compression": "packbits"}])
def test_pages_of_a_compressed_stack(tmp_path, options):
    path = stack(tmp_path / "a.tif", **options)
    np.testing.assert_array_equal(np.stack([read_grey(FilePart(path, k + 1)) for k in range(4)]), PAGES)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_both_byte_orders_and_sizes_of_tiff(tmp_path, order, big, dtype):
    pages = PAGES.astype(dtype) * (1 if dtype is np.uint8 else 257)
    path = tmp_path / "a.tif"
    path.write_bytes(tiff(pages, order, big))
    assert page_count(path) == 4
    np.testing.assert_array_equal(np.stack([read_grey(FilePart(path, k + 1)) for k in range(4)]), pages)


def test_a_stack_of_colour_with_16_bits_keeps_its_depth(tmp_path):
    path = tmp_path / "a.tif"
    levels = PAGES.astype(np.uint16) * 200
    cv2.imwritemulti(str(path), [np.dstack([page] * 3) for page in levels])
    assert probe(FilePart(path, 3))["bits"] == 16
    np.testing.assert_array_equal(read_grey(FilePart(path, 3)), levels[2])


def test_smaller_copies_and_masks_are_no_steps(tmp_path):
    path = tmp_path / "a.tif"
    path.write_bytes(tiff([PAGES[0], PAGES[1, ::4, ::4], PAGES[2], PAGES[3]], more=[{}, {254: 1}, {254: 4}, {255: 2}]))
    assert page_count(path) == 1
    assert list(Images(left="*.tif").steps(tmp_path)) == ["a"]
    np.testing.assert_array_equal(read_grey(path), PAGES[0])


def test_a_preview_before_the_photograph_is_passed_over(tmp_path):
    path = tmp_path / "a.tif"
    path.write_bytes(tiff([PAGES[1, ::4, ::4], PAGES[0]], more=[{254: 1}]))
    np.testing.assert_array_equal(read_grey(path), PAGES[0])


@pytest.mark.parametrize("more", [{50706: 1}, {262: 32803}, {254: 1, 330: 8}])
def test_a_raw_file_of_a_camera_is_named(tmp_path, more):
    path = tmp_path / "a.tif"
    path.write_bytes(tiff(PAGES[:1], more=[more]))
    with pytest.raises(InputError, match=r"a\.tif: a camera's raw file .*develop it to TIFF with 16 bits"):
        probe(path)


def test_pages_that_lie_upon_one_another_are_damage(tmp_path):
    """A small file cannot hold many pages of many tags: whoever looks through them would never end."""
    path, count, tags = tmp_path / "a.tif", 100, 20_000
    first, table = 8, 2 + 12 * tags
    content = bytearray(first + table + 4 * count + 4)
    content[:8] = b"II*\0" + struct.pack("<I", first)
    for place in range(first, first + 4 * count, 4):
        content[place : place + 2] = struct.pack("<H", tags)
        content[place + table : place + table + 4] = struct.pack("<I", place + 4)
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.tif: .*damaged"):
        probe(path)


@pytest.mark.parametrize("tags", [{257: 25}, {257: 8_000_000}, {278: 12}, {256: 0}, {278: 0}])
def test_a_page_without_all_its_strips_is_damage(tmp_path, tags):
    """Libraries leave the missing rows black."""
    path = tmp_path / "a.tif"
    path.write_bytes(tiff(PAGES[:1], more=[tags | {278: tags.get(278, 24)}]))
    with pytest.raises(InputError, match=r"a\.tif: .*damaged"):
        read_grey(path)


def test_a_stack_whose_pages_cannot_be_found_is_named(tmp_path):
    path = tmp_path / "a.tif"
    stack(path, PAGES[:1], tiffinfo={270: "ImageJ=1.54f\nimages=4\nslices=4\n"})
    with pytest.raises(InputError, match=r"a\.tif: ImageJ says that it holds 4 images, but 1"):
        probe(path)


def test_pages_that_lead_in_a_circle_are_damage(tmp_path):
    path = tmp_path / "a.tif"
    content = bytearray(tiff(PAGES[:1]))
    content[8 + 2 + 9 * 12 : 8 + 2 + 9 * 12 + 4] = struct.pack("<I", 8)
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.tif: .*damaged"):
        probe(path)


def test_strips_upon_one_another_are_damage(tmp_path):
    """A small file cannot fill the memory."""
    path, count = tmp_path / "a.tif", 2000
    data, room = np.zeros(100_000, dtype=np.uint8).tobytes(), 8 + 100_000
    tags = {256: (1000,), 257: (count * 100,), 258: (8,), 259: (1,), 262: (1,), 277: (1,), 278: (100,)}
    tags |= {273: (8,) * count, 279: (100_000,) * count}
    table = room + 2 + 12 * len(tags) + 4
    rows, behind = b"", b""
    for tag, values in sorted(tags.items()):
        place = values[0] if len(values) == 1 else table + len(behind)
        rows += struct.pack("<HHII", tag, 4, len(values), place)
        behind += struct.pack(f"<{count}I", *values) if len(values) > 1 else b""
    head = b"II*\0" + struct.pack("<I", room)
    path.write_bytes(head + data + struct.pack("<H", len(tags)) + rows + bytes(4) + behind)
    with pytest.raises(InputError, match=r"a\.tif"):
        read_photograph(FilePart(path, 1))


def test_left_and_right_stacks_are_paired_page_by_page(tmp_path):
    stack(tmp_path / "l" / "cam0.tif", PAGES[:3])
    stack(tmp_path / "r" / "cam1.tif", PAGES[1:])
    steps = Images(left="l/*.tif", right="r/*.tif").steps(tmp_path)
    assert [(files["left"].number, files["right"].number) for files in steps.values()] == [(1, 1), (2, 2), (3, 3)]


def test_stacks_of_unequal_length_are_refused(tmp_path):
    stack(tmp_path / "l" / "a.tif", PAGES[:3])
    stack(tmp_path / "r" / "b.tif")
    with pytest.raises(InputError, match=r"a\.tif: 3 pages, but .*b\.tif has 4"):
        Images(left="l/*.tif", right="r/*.tif").steps(tmp_path)


def test_a_stack_beside_single_files(tmp_path):
    stack(tmp_path / "s_1.tif", PAGES[:2])
    for name in ("s_0.png", "s_2.png"):
        Image.fromarray(PAGES[3]).save(tmp_path / name)
    assert list(Images(left="s_*").steps(tmp_path)) == ["s_0", "s_1_001", "s_1_002", "s_2"]
    Image.fromarray(PAGES[3]).save(tmp_path / "s_1_002.png")
    with pytest.raises(InputError, match=r"would both be step 's_1_002'"):
        Images(left="s_*").steps(tmp_path)


def test_a_page_of_another_size_is_named(tmp_path):
    node, path = Images(left="*.tif"), tmp_path / "a.tif"
    path.write_bytes(tiff([PAGES[0], PAGES[1, ::2, ::2]]))
    steps = node.steps(tmp_path)
    facts = {file: node.check(file) for files in steps.values() for file in files.values()}
    with pytest.raises(InputError, match=r"a\.tif#2: 16 × 12 px at 8 bit, but a\.tif has 32 × 24 px"):
        node.agree(facts, steps, {})


def test_the_digest_of_a_page_is_that_of_its_contents(tmp_path):
    one, other = stack(tmp_path / "a.tif"), stack(tmp_path / "b.tif", PAGES[[3, 1]], compression="tiff_lzw")
    assert probe(FilePart(one, 2))["digest"] == probe(FilePart(other, 2))["digest"]
    assert probe(FilePart(one, 1))["digest"] != probe(FilePart(other, 1))["digest"]


def test_frames_of_an_animated_png_are_steps(tmp_path):
    path = stack(tmp_path / "a.png", form="PNG")
    assert page_count(path) == 4
    np.testing.assert_array_equal(np.stack([read_grey(FilePart(path, k + 1)) for k in range(4)]), PAGES)


def test_a_picture_that_is_not_part_of_the_animation_is_no_step(tmp_path):
    path = stack(tmp_path / "a.png", form="PNG", default_image=True)
    assert page_count(path) == 3
    np.testing.assert_array_equal(read_grey(FilePart(path, 1)), PAGES[1])


def test_an_animation_larger_than_its_file_can_hold_is_damage(tmp_path):
    """Its frames may cover parts of the picture; a few bytes would become gigabytes."""
    path = stack(tmp_path / "a.png", form="PNG")
    content = bytearray(path.read_bytes())
    content[20:24] = struct.pack(">I", 4_000_000)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.png#2: .*damaged"):
        read_grey(FilePart(path, 2))


def test_frames_that_would_be_drawn_for_hours_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("dicflow.io.images.reading._MOST_ANIMATED_PIXELS", PAGES.size - 1)
    path = stack(tmp_path / "a.png", form="PNG")
    with pytest.raises(InputError, match=r"a\.png#2: an animation of 4 large frames; save them as single"):
        read_grey(FilePart(path, 2))


def test_a_page_that_is_no_longer_there_is_named(tmp_path):
    path = stack(tmp_path / "a.tif", PAGES[:2])
    with pytest.raises(InputError, match=r"a\.tif#3: .*damaged"):
        read_photograph(FilePart(path, 3))


def test_orientation_of_every_page(tmp_path):
    path = tmp_path / "a.tif"
    path.write_bytes(tiff(PAGES[:2], more=[{274: 3}, {274: 6}]))
    assert [probe(FilePart(path, k))["orientation"] for k in (1, 2)] == [3, 6]
    np.testing.assert_array_equal(read_grey(FilePart(path, 1)), PAGES[0])


def test_memory_for_one_page_is_enough(tmp_path):
    """The strips of one page are read, not those of the others."""
    from dicflow.io.images.tiff import Tiff

    content = BytesIO(tiff(PAGES))
    pages = Tiff(content).photographs()
    assert max(len(Tiff(content).alone(page)) for page in pages) < PAGES[0].nbytes + 300
