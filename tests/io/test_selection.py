"""Which steps are measured, and when they were taken."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from dicflow.engine.files import FilePart
from dicflow.errors import InputError
from dicflow.io.images import Selection, moment_of, read_times, selected
from tests.core.motion.test_survey import shifted
from tests.io.test_videos import VIDEOS, pictures
from tests.video_scene import write_video

STEPS = {f"s{k}": {"left": Path(f"s{k}.png")} for k in range(1, 11)}
TIMES = {files["left"]: 2.0 * k + 100.0 for k, files in enumerate(STEPS.values())}


def chosen(reference=None, time=TIMES.get, **conditions):
    return [int(name[1:]) for name in selected(STEPS, Selection(**conditions), time, reference)]


@pytest.mark.parametrize(
    ("conditions", "expected"),
    [
        ({}, [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]),
        ({"every": 4}, [1, 5, 9]),
        ({"first": 3, "last": 6}, [3, 4, 5, 6]),
        ({"first": 4.0, "last": 10.9}, [3, 4, 5, 6]),
        ({"first": 2, "every": 3}, [2, 5, 8]),
        ({"at": (9, 2, 7.2, 2)}, [2, 5, 9]),
        ({"at": (9, 2, 7.2, 2), "every": 2}, [2, 9]),
        ({"without": (2, "s4"), "every": 3}, [1, 6, 9]),
        ({"at": (2, 3, 4), "without": (3,)}, [2, 4]),
        ({"reference": 5}, [5, 1, 2, 3, 4, 6, 7, 8, 9, 10]),
        ({"reference": 4.1, "every": 4}, [3, 1, 5, 9]),
    ],
)
def test_steps_by_number_and_by_time(conditions, expected):
    assert chosen(**conditions) == expected


@pytest.mark.parametrize(
    ("conditions", "message"),
    [
        ({"at": (11,)}, "step 11 does not exist; the series has steps 1 to 10"),
        ({"without": ("s77",)}, "no step 's77', did you mean 's7'"),
        ({"without": (12,)}, "step 12 does not exist"),
        ({"first": 0}, "step 0 does not exist"),
        ({"last": 40.0}, r"40 s lies outside the series, which takes 18\.00 s"),
        ({"first": 6, "last": 3}, "no step lies from 6 to 3"),
        ({"first": 2.0, "time": lambda file: None}, r"nobody knows when s1\.png was taken"),
        ({"first": 2.0, "time": lambda file: -TIMES[file]}, "not in the order of their times"),
    ],
)
def test_steps_that_do_not_exist(conditions, message):
    with pytest.raises(InputError, match=message):
        chosen(**conditions)


@pytest.fixture
def resting(tmp_path):
    """Photographs of a pattern that rests, moves, and rests: their places [px]."""
    places = [0.0, 0.0, 0.1, 0.0, 1.5, 3.0, 3.1, 3.0, 3.0]
    for k, place in enumerate(places):
        cv2.imwrite(str(tmp_path / f"{k}.png"), shifted(place, 0.0))
    return {str(k): {"left": tmp_path / f"{k}.png"} for k in range(len(places))}


def test_rests_are_thinned_out(resting):
    assert list(selected(resting, Selection(moved=1.0), lambda file: None)) == ["0", "4", "5"]


def test_the_sharpest_photographs_that_differ(resting):
    assert len(selected(resting, Selection(sharpest=2), lambda file: None)) == 2


def test_times_of_frames_names_tables_and_metadata(tmp_path):
    assert moment_of(FilePart(VIDEOS / "b_frames.mp4", 4)) == pytest.approx(0.1)
    assert moment_of(tmp_path / "F_0012_t3.75.png", in_names=True) == 3.75
    with pytest.raises(InputError, match="no number that could be the time"):
        moment_of(tmp_path / "first.png", in_names=True)
    photograph = tmp_path / "a.jpg"
    Image.fromarray(np.full((8, 8), 90, np.uint8)).save(photograph)
    assert moment_of(photograph) is None


@pytest.mark.parametrize("text", ["name,time\na.jpg,0.5\nb,1.25\n", "time_s;name;x\n0,5;a.jpg;1\n1,25;b;2\n"])
def test_a_table_of_times(tmp_path, text):
    path = tmp_path / "times.csv"
    path.write_text(text)
    table = read_times(path)
    assert table == {"a.jpg": 0.5, "b": 1.25}
    assert moment_of(tmp_path / "b.tif", table=table) == 1.25
    with pytest.raises(InputError, match=r"c\.tif: the table of times has no row 'c'"):
        moment_of(tmp_path / "c.tif", table=table)


def test_a_table_of_times_by_number(tmp_path):
    path = tmp_path / "times.csv"
    path.write_text("number,time\n1,10\n2,20\n")
    assert moment_of(FilePart(tmp_path / "a.tif", 2), table=read_times(path)) == 20.0


@pytest.mark.parametrize(
    ("text", "message"),
    [("a,b\n1,2\n", "name or number"), ("name,time\na,x\n", "time is 'x'"), ("name,time\na,1\na,2\n", "two times")],
)
def test_tables_that_are_none(tmp_path, text, message):
    path = tmp_path / "times.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_times(path)


def test_frames_by_time(tmp_path):
    write_video(tmp_path / "a.mp4", pictures(12), 10.0)
    steps = {str(k): {"left": FilePart(tmp_path / "a.mp4", k)} for k in range(1, 13)}
    assert list(selected(steps, Selection(first=0.52, last=0.8), moment_of)) == ["6", "7", "8", "9"]
