"""Videos: which frames there are and when, and their grey levels in any order.

The files in ``videos`` hold twelve frames of H.264 whose left part gets brighter by 18 grey levels per frame.
"""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from dicflow.engine.files import FilePart
from dicflow.errors import InputError
from dicflow.io.images import page_count, probe, read_photograph, video_of, video_stream
from dicflow.io.images.frame_pairs import lag_sentence, length_sentence, pair_frames
from dicflow.io.images.surveys import survey_of
from dicflow.io.images.video_stream import read_frame
from tests.mp4 import Mp4
from tests.video_scene import write_video

VIDEOS = Path(__file__).parent / "videos"
STEP, DARKEST = 18.0, 20.0
CODECS = {"a.mp4": "mp4v", "a.avi": "MJPG", "b.avi": "XVID", "a.mov": "mp4v", "a.mkv": "FFV1"}


def pictures(count, size=(48, 64)):
    """Pictures whose left part gets brighter, of which a video keeps at least the mean."""
    for k in range(count):
        picture = np.full(size, 128, np.uint8)
        picture[:, : size[1] // 2] = DARKEST + STEP * (k % 12)
        yield picture


def numbers(path, order):
    """Numbers of the frames that are found where frames are asked for, from their grey levels."""
    found = [read_frame(path, k)[20:, 8:24].mean() for k in order]
    return [round((float(one) - DARKEST) / STEP) + 1 for one in found]


@pytest.mark.parametrize("name", CODECS)
def test_frames_of_every_container_in_order_and_at_random(tmp_path, name):
    write_video(tmp_path / name, pictures(12), 25.0, CODECS[name])
    path, order = tmp_path / name, [7, 2, 12, 1, 1, 6, 5, 4, 12]
    video = video_of(path)
    assert (video.width, video.height, video.orientation, video.complaint) == (64, 48, 1, "")
    np.testing.assert_allclose(video.times, np.arange(12) / 25.0, atol=6e-4)
    assert video.is_steady
    assert page_count(path) == 12
    assert numbers(path, range(1, 13)) == list(range(1, 13))
    assert numbers(path, order) == order


@pytest.mark.parametrize(
    ("name", "first", "times"),
    [
        ("b_frames.mp4", 1, np.arange(12) / 30),
        ("trimmed.mp4", 4, np.arange(9) / 30),
        ("varying_rate.mov", 1, [(k + 0.3 * (k % 2) + 5 * (k > 7)) / 30 for k in range(12)]),
    ],
)
def test_times_and_frames_where_a_file_has_them_in_another_order_or_leaves_some_out(name, first, times):
    path = VIDEOS / name
    np.testing.assert_allclose(video_of(path).times, times, atol=6e-4)
    assert video_of(path).is_steady == (name != "varying_rate.mov")
    order = [*range(1, len(times) + 1), 3, 9, 2, 7, 8, 1]
    assert numbers(path, order) == [first + k - 1 for k in order]


def test_a_turned_video_is_read_as_the_sensor_lies_and_says_so():
    found = read_photograph(FilePart(VIDEOS / "turned.mp4", 3))
    assert found.orientation == 6
    assert found.grey.shape == (48, 64)
    assert probe(FilePart(VIDEOS / "turned.mp4", 3)) == {
        "width": 64,
        "height": 48,
        "bits": 8,
        "orientation": 6,
        "mosaic": None,
    }


class Counting:
    """A capture that counts the frames it decodes."""

    def __init__(self, capture, counts):
        self._capture, self._counts = capture, counts

    def __getattr__(self, name):
        self._counts[name] = self._counts.get(name, 0) + 1
        return getattr(self._capture, name)


def test_frames_that_follow_one_another_are_decoded_once(tmp_path, monkeypatch):
    write_video(tmp_path / "a.mp4", pictures(60), 30.0)
    counts, start = {}, video_stream.start
    monkeypatch.setattr(video_stream, "start", lambda path: Counting(start(path), counts))
    for k in [1, 2, 4, 3, 5, *range(6, 61)]:
        read_frame(tmp_path / "a.mp4", k)
    assert counts["grab"] == 60


def test_a_file_that_ends_early_says_how_far_it_can_be_read(tmp_path):
    write_video(tmp_path / "whole.mkv", pictures(60, (240, 320)), 30.0, "FFV1")
    data, path = (tmp_path / "whole.mkv").read_bytes(), tmp_path / "part.mkv"
    path.write_bytes(data[: len(data) * 2 // 3])
    assert 20 < len(video_of(path).times) < 60
    assert video_of(path).complaint
    assert numbers(path, [20]) == [8]


@pytest.mark.parametrize("damage", [bytes, lambda size: np.random.default_rng(1).bytes(size)])
def test_a_frame_in_the_middle_that_cannot_be_decoded_costs_no_other(tmp_path, damage):
    path, damaged = tmp_path / "a.mp4", tmp_path / "damaged.mp4"
    write_video(path, pictures(60), 30.0)
    film = Mp4(path.read_bytes())
    damaged.write_bytes(film.with_frame(30, damage))
    assert len(video_of(damaged).times) == 60
    order = [*range(1, 30), *range(31, 61), 29, 31, 45, 12]
    assert numbers(damaged, order) == [(k - 1) % 12 + 1 for k in order]
    for _ in range(2):
        with pytest.raises(InputError, match=r"damaged\.mp4#30: the frame cannot be decoded; .*without: \["):
            read_frame(damaged, 30)
    files = {name: [FilePart(one, k) for k in range(1, 61)] for name, one in (("whole", path), ("damaged", damaged))}
    whole, found = (survey_of(files[name]).level for name in ("whole", "damaged"))
    np.testing.assert_allclose(np.delete(found, 29), np.delete(whole, 29), atol=0.5)
    assert found[29] == found[28]


def test_frames_that_a_camera_dropped_leave_a_gap_in_the_times(tmp_path):
    """Frames 21 … 23 were never recorded: the others keep their times, and the rate counts as varying."""
    path = tmp_path / "a.mp4"
    write_video(path, pictures(40), 25.0)
    path.write_bytes(Mp4(path.read_bytes()).with_gap(20, 4))
    video = video_of(path)
    expected = np.where(np.arange(40) < 20, np.arange(40), np.arange(40) + 3) / 25.0
    np.testing.assert_allclose(video.times, expected[: len(video.times)], atol=6e-4)
    assert len(video.times) >= 36  # an index that keeps its length hides the last ones
    assert not video.is_steady
    order = [22, 3, 20, 21, 36, 1]
    assert numbers(path, order) == [(k - 1) % 12 + 1 for k in order]


def test_a_header_that_claims_more_frames_than_there_are_is_not_believed(tmp_path):
    write_video(tmp_path / "a.avi", pictures(30), 25.0, "MJPG")
    data, path = bytearray((tmp_path / "a.avi").read_bytes()), tmp_path / "more.avi"
    for name, place in ((b"avih", 24), (b"strh", 40)):
        start = data.find(name) + place
        assert int.from_bytes(data[start : start + 4], "little") == 30
        data[start : start + 4] = (90).to_bytes(4, "little")
    path.write_bytes(data)
    assert len(video_of(path).times) == 30
    assert numbers(path, [30, 7]) == [6, 7]


def test_a_video_without_its_index_is_refused(tmp_path):
    path = tmp_path / "cut_off.mp4"
    path.write_bytes((VIDEOS / "b_frames.mp4").read_bytes()[:900])
    with pytest.raises(InputError, match=r"cut_off\.mp4: the video cannot be opened .*recording was interrupted"):
        video_of(path)
    with pytest.raises(InputError, match=r"cut_off\.mp4"):
        probe(FilePart(path, 1))
    assert page_count(path) == 1


def test_a_frame_that_does_not_exist():
    with pytest.raises(InputError, match=r"b_frames\.mp4#13: the video has 12 frames"):
        read_frame(VIDEOS / "b_frames.mp4", 13)


def test_damaged_videos_give_frames_or_an_error(tmp_path):
    whole, rng, path = (VIDEOS / "b_frames.mp4").read_bytes(), np.random.default_rng(1), tmp_path / "a.mp4"
    for _ in range(25):
        data = bytearray(whole)
        for place in rng.integers(32, len(data), 12):
            data[place] = rng.integers(256)
        path.write_bytes(data)
        with suppress(InputError):
            count = min(len(video_of(path).times), 30)
            assert all(read_frame(path, k + 1).ndim == 2 for k in range(count))


@pytest.fixture(scope="module")
def two_rates(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rates")
    write_video(folder / "left.mp4", pictures(60), 30.0)
    write_video(folder / "right.mp4", pictures(40), 25.0)
    return folder / "left.mp4", folder / "right.mp4"


@pytest.mark.parametrize("offset", [0.0, 0.37, -0.2])
def test_frames_are_paired_with_the_nearest_in_time_once_at_most(two_rates, offset):
    pairs = pair_frames(*two_rates, offset)
    left, right = np.array([(one.left, one.right) for one in pairs]).T
    lags = (right - 1) / 25.0 + offset - (left - 1) / 30.0
    np.testing.assert_allclose([one.lag for one in pairs], lags, atol=1e-3)
    assert np.abs(lags).max() <= 0.5 / 30.0 + 1e-3
    assert len(set(left)) == len(left) == len(set(right))
    times = np.arange(40) / 25.0 + offset
    assert len(pairs) == int(((times > -0.5 / 30) & (times < 59.5 / 30)).sum())


def test_sentences_about_lengths_and_lags(two_rates):
    pairs = pair_frames(*two_rates, 0.0)
    assert f"give {len(pairs)} pairs: {60 - len(pairs)} left and 0 right frames" in length_sentence(*two_rates, pairs)
    longest = max(abs(one.lag) for one in pairs)
    assert f"up to {1000 * longest:.1f} ms apart" in lag_sentence(*two_rates, pairs)
    same = pair_frames(two_rates[0], two_rates[0], 0.0)
    assert lag_sentence(two_rates[0], two_rates[0], same) == length_sentence(two_rates[0], two_rates[0], same) == ""


def test_videos_that_share_no_time_are_refused(two_rates):
    with pytest.raises(InputError, match=r"share no time, since the right one begins 9\.000 s after"):
        pair_frames(*two_rates, 9.0)
