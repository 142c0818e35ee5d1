"""The stage of the photographs: frames of videos, chosen steps, and times."""

import shutil

import numpy as np
import pytest
from pydantic import ValidationError

from dicflow.engine.files import FilePart
from dicflow.errors import InputError
from dicflow.kinds.images import Images as Photographs
from dicflow.stages.images import Images
from tests.io.test_videos import DARKEST, STEP, VIDEOS, pictures
from tests.video_scene import write_video


@pytest.fixture
def folder(tmp_path):
    """Videos of 12 frames at 30 and at 25 frames/s."""
    write_video(tmp_path / "left.mp4", pictures(12), 30.0)
    write_video(tmp_path / "right.mp4", pictures(12), 25.0)
    return tmp_path


def numbers(steps, side):
    return [files[side].number for files in steps.values()]


def test_every_frame_of_a_video_is_a_step_with_its_time(folder):
    node = Images(left="left.mp4")
    steps = node.steps(folder)
    assert list(steps)[::11] == ["left_001", "left_012"]
    products = [Photographs.read(node.run(**files)) for files in steps.values()]
    np.testing.assert_allclose([one.time for one in products], np.arange(12) / 30.0, atol=1e-3)
    found = [float(one.left[20:, 8:24].mean()) for one in products]
    np.testing.assert_allclose(found, DARKEST + STEP * np.arange(12), atol=4.0)


def test_frames_of_two_videos_with_a_given_offset(folder):
    steps = Images(left="left.mp4", right="right.mp4", offset="100 ms").steps(folder)
    left, right = np.array(numbers(steps, "left")), np.array(numbers(steps, "right"))
    assert np.abs((right - 1) / 25.0 + 0.1 - (left - 1) / 30.0).max() <= 0.5 / 30.0 + 1e-3
    product = Photographs.read(Images(left="left.mp4", right="right.mp4").run(**next(iter(steps.values()))))
    assert product.has_right
    assert product.time == pytest.approx((left[0] - 1) / 30.0, abs=1e-3)


def test_videos_whose_clocks_nothing_joins_are_refused(folder):
    with pytest.raises(InputError, match=r"left\.mp4 and .*right\.mp4: the clocks cannot be joined.* give offset"):
        Images(left="left.mp4", right="right.mp4").steps(folder)


def test_one_file_in_the_place_of_both_cameras_is_refused(folder):
    shutil.copy(folder / "left.mp4", folder / "copy.mp4")
    with pytest.raises(InputError, match=r"^left\.mp4: is the left and the right camera's"):
        Images(left="left.mp4", right="left.mp4", offset=0.0).steps(folder)
    with pytest.raises(InputError, match=r"copy\.mp4: is a copy of left\.mp4"):
        Images(left="left.mp4", right="copy.mp4", offset=0.0).steps(folder)


@pytest.mark.parametrize(("content", "said"), [(b"", "is empty"), (b"no video", "text, not a photograph")])
def test_a_video_beside_a_file_that_holds_none(folder, content, said):
    (folder / "none.mp4").write_bytes(content)
    with pytest.raises(InputError, match=rf"none\.mp4: .*{said}"):
        Images(left="left.mp4", right="none.mp4").steps(folder)


def test_a_video_that_a_phone_has_turned_beside_one_that_it_has_not(tmp_path):
    shutil.copy(VIDEOS / "turned.mp4", tmp_path / "left.mp4")
    shutil.copy(VIDEOS / "b_frames.mp4", tmp_path / "right.mp4")
    node = Images(left="left.mp4", right="right.mp4", offset=0.0)
    steps = dict(list(node.steps(tmp_path).items())[:2])
    facts = {file: node.check(file) for files in steps.values() for file in files.values()}
    with pytest.raises(InputError, match=r"left\.mp4: tagged as rotated \(orientation 6\) .*orientation: upright"):
        node.agree(facts, steps, {})
    upright = node.model_copy(update={"orientation": "upright"})
    upright.agree(facts, steps, {})
    turned = Photographs.read(upright.run(**steps["left_001"]))
    assert (turned.left.shape, turned.right.shape) == ((64, 48), (48, 64))


def test_sentences_about_two_videos(folder):
    node = Images(left="left.mp4", right="right.mp4", offset=0.0)
    sentences = node.left_out(folder, node.steps(folder))
    assert [one.split(":")[0].split(" (")[0] for one in sentences] == ["left.mp4", "left.mp4 and right.mp4"]
    shutil.copy(VIDEOS / "varying_rate.mov", folder)
    (sentence,) = Images(left="varying_rate.mov").left_out(folder, {})
    assert "variable frame rate" in sentence


def test_a_broken_tail_is_left_out_and_said(tmp_path):
    write_video(tmp_path / "whole.mkv", pictures(40, (120, 160)), 30.0, "FFV1")
    data = (tmp_path / "whole.mkv").read_bytes()
    (tmp_path / "part.mkv").write_bytes(data[: len(data) * 2 // 3])
    node = Images(left="part.mkv")
    steps = node.steps(tmp_path)
    assert 10 < len(steps) < 40
    (sentence,) = node.left_out(tmp_path, steps)
    assert sentence.startswith("part.mkv: damaged (")
    assert f"); {len(steps)} frames can be read, up to {(len(steps) - 1) / 30.0:.2f} s; copy it again" in sentence


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ({"select": {"from": "0.1 s", "to": 9, "every": 2}}, [4, 6, 8]),
        ({"select": {"at": [2, "200 ms"]}}, [2, 7]),
        ({"select": {"from": 9}, "reference": 10}, [10, 9, 11, 12]),
        ({"reference": "0.3 s", "select": {"every": 6}}, [10, 1, 7]),
    ],
)
def test_steps_by_number_and_time(folder, more, expected):
    assert numbers(Images(left="left.mp4", **more).steps(folder), "left") == expected


def test_rests_are_thinned_out_by_auto(folder):
    write_video(folder / "still.mp4", (next(pictures(1)) for _ in range(6)), 30.0)
    assert numbers(Images(left="still.mp4", select="auto").steps(folder), "left") == [1]


@pytest.mark.parametrize("select", [{"every": 0}, {"moved": -1}, {"at": []}, {"from": "3 px"}, {"until": 3}])
def test_selections_that_are_none(select):
    with pytest.raises(ValidationError):
        Images(left="left.mp4", select=select)


def test_times_of_names_and_of_a_table(folder):
    (folder / "times.csv").write_text("number,time\n" + "".join(f"{k},{10 * k}\n" for k in range(1, 13)))
    node = Images(left="left.mp4", times="times.csv", select={"from": "20 s", "to": "40 s"})
    assert numbers(node.steps(folder), "left") == [3, 4, 5]
    assert node.check(folder / "times.csv") == {"rows": 12}
    product = node.run(left=FilePart(folder / "left.mp4", 3), times_path=folder / "times.csv")
    assert Photographs.read(product).time == 30.0


def test_a_video_beside_other_files_is_refused(folder):
    with pytest.raises(InputError, match="a video and one of 2 files"):
        Images(left=["left.mp4", "right.mp4"]).steps(folder)
    shutil.copy(VIDEOS.parent / "photographs" / "as_taken.heic", folder / "photo.heic")
    with pytest.raises(InputError, match="a video and photographs"):
        Images(left="left.mp4", right="photo.heic").steps(folder)


def test_a_pattern_finds_videos_where_there_are_no_photographs(folder):
    assert len(Images(left="l*").steps(folder)) == 12
