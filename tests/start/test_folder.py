"""Folders with photographs: what init finds in them, asks about them, and writes."""

from __future__ import annotations

import os
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from boards import board_photograph
from PIL import Image
from small import dicflow

from dicflow.core.calibration.board import Board
from dicflow.core.cameras.camera import Camera, rotation_matrix
from dicflow.core.synthetic.charuco import CharucoBoard, charuco_darkness, charuco_extent
from dicflow.core.synthetic.checkerboard import Checkerboard
from dicflow.core.synthetic.circles import CircleGrid, circle_darkness, circle_extent
from dicflow.core.synthetic.deformation import Deformation
from dicflow.core.synthetic.planar import planar_pair
from dicflow.core.synthetic.render import GreyLevels, photograph
from dicflow.errors import InputError
from dicflow.io.configuration import parse
from dicflow.start.choice import Choice
from dicflow.start.folder import look
from tests.io.calibration_files import made_rig, matchid

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("boards_recognised_once")]

SIZE = (420, 320)
STEPS, BOARDS = 3, 4
MARKED = CharucoBoard(Checkerboard(7, 5, 14.0, 4.0, 0.4), 0.7, "4x4_50")
GRID = CircleGrid(7, 5, 13.0, 4.0, margin=10.0, edge=0.4)
SHIFTED = CircleGrid(4, 9, 8.0, 3.6, asymmetric=True, margin=9.0, edge=0.4)


@pytest.fixture(scope="module")
def specimen():
    """Speckles that stretch by 4 % along x at each step."""
    pairs = [planar_pair(SIZE, np.diag([1.0 + 0.04 * k, 1.0 - 0.01 * k, 1.0]), seed=2) for k in range(1, STEPS)]
    return [pairs[0].reference, *(pair.deformed for pair in pairs)]


@pytest.fixture(scope="module")
def boards():
    """A checkerboard of 7 × 5 inner corners in four places."""
    homographies = [[[34 + k, 3, 70 + 9 * k], [-2, 33 - k, 80 - 5 * k], [0, 1e-3 * k, 1]] for k in range(BOARDS)]
    return [board_photograph(np.array(one, dtype=float), SIZE[::-1], (7, 5), finer=3) for one in homographies]


def write(folder: Path, patterns: dict, exif=None, first=1) -> Path:
    """Write pictures under the names of patterns."""
    for pattern, pictures in patterns.items():
        for k, picture in enumerate(pictures, start=first):
            path = folder / pattern.format(k)
            path.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(np.asarray(picture, dtype=np.uint8)).save(path, **({"exif": exif} if exif else {}))
    return folder


def stages(folder: Path):
    return parse((folder / "pipeline.yaml").read_text(), "pipeline.yaml").data["stages"]


def targets(extent, pattern):
    """A target in four places, 640 × 480 px."""
    camera = Camera(np.array([[900.0, 0, 320], [0, 900, 240], [0, 0, 1]]), np.zeros(5), (640, 480))
    middle = np.array([extent.left + extent.right, extent.top + extent.bottom, 0.0]) / 2.0
    for k in range(BOARDS):
        turn = rotation_matrix([0.2 - 0.1 * k, 0.1 * k, 0.05 * k])
        place = np.array([3.0 * k, -4.0, 260.0 + 5.0 * k])
        pose = Deformation(1.0, 1.0, rotation=turn, translation=place - turn @ middle)
        yield np.round(photograph(camera, pose, extent, pattern, GreyLevels(paper=205.0, ink=34.0), 2))


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("{}/cam 0/{{}}.png", "{}/cam 1/{{}}.png"),
        ("{}_{{}}_L.png", "{}_{{}}_R.png"),
    ],
)
def test_boards_are_found_by_what_photographs_show(tmp_path, specimen, boards, left, right):
    """The names say nothing of boards."""
    folder = write(tmp_path, {side.format(name): shown for side in (left, right)
                              for name, shown in (("alpha", boards), ("beta", specimen))})  # fmt: skip
    answer = dicflow("init", folder, "--square", "10 mm")
    assert answer.code == 0, answer.err
    assert stages(folder)["corners"] == {"stage": "corners", "images": "boards", "size": [7, 5]}
    assert "beta" in stages(folder)["photos"]["left"]
    assert "alpha" in stages(folder)["boards"]["right"]
    assert f"specimen: {STEPS} pairs" in answer.out
    assert f"boards: {BOARDS} pairs" in answer.out


@pytest.mark.slow
def test_photographs_of_both_subjects_with_one_numbering_are_divided(tmp_path, specimen, boards):
    """As two phones leave them, each with a counter of its own."""
    shown = [*boards, *boards, *specimen]
    write(tmp_path, {"iPhone 12/IMG_{:04}.JPG": shown}, first=231)
    write(tmp_path, {"Pixel 7/PXL_{:04}.jpg": shown}, first=1877)
    answer = dicflow("init", tmp_path, "--square", "10 mm")
    assert answer.code == 0, answer.err
    photos, rig = stages(tmp_path)["photos"], stages(tmp_path)["boards"]
    assert photos["left"] == [f"iPhone 12/IMG_{k:04}.JPG" for k in (239, 240, 241)]
    assert photos["right"] == [f"Pixel 7/PXL_{k:04}.jpg" for k in (1885, 1886, 1887)]
    assert photos["pair_by"] == "order"
    assert len(rig["left"]) == len(rig["right"]) == 2 * BOARDS


def test_two_cameras_under_one_counter_are_asked_about(tmp_path, specimen, boards):
    """The answers are the command lines: the first one measures both cameras."""
    write(tmp_path, {"IMG_{:04}.png": [*boards, *specimen, *boards, *specimen]}, first=101)
    answer = dicflow("init", tmp_path, "--square", "10 mm")
    assert answer.code == 2
    assert "2 series of the specimen look alike (3, 3 photographs)" in answer.err
    command = next(shlex.split(line) for line in answer.err.splitlines() if line.startswith("  dicflow init "))
    again = dicflow(*command[1:])
    assert again.code == 0, again.err
    found = stages(tmp_path)
    assert found["photos"]["left"] == [f"IMG_{k:04}.png" for k in (105, 106, 107)]
    assert found["boards"]["right"] == [f"IMG_{k:04}.png" for k in (108, 109, 110, 111)]


def test_boards_beside_one_series_are_asked_about(tmp_path, specimen, boards):
    """Both cameras' photographs may alternate under one counter; one that is said to be alone measures."""
    write(tmp_path, {"IMG_{:04}.png": [*boards, *specimen]})
    answer = dicflow("init", tmp_path)
    answer.refuses(2, "4 photographs of a board, but one series of the specimen (3 photographs)")
    answer.refuses(2, "or two cameras: move the photographs of each into a folder of its own, named left and right")
    assert f"  dicflow init {tmp_path} --one-camera" in answer.err.splitlines()
    assert dicflow("init", tmp_path, "--one-camera").out.startswith("specimen: 3 photographs of one camera")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("extent", "pattern", "values"),
    [
        (
            charuco_extent(MARKED),
            lambda points: charuco_darkness(MARKED, points),
            {"size": [6, 4], "target": "charuco", "dictionary": "4x4_50"},
        ),
        (circle_extent(GRID), lambda points: circle_darkness(GRID, points), {"size": [7, 5], "target": "circles"}),
        (
            circle_extent(SHIFTED),
            lambda points: circle_darkness(SHIFTED, points),
            {"size": [4, 9], "target": "asymmetric_circles"},
        ),
    ],
    ids=["charuco", "circles", "asymmetric circles"],
)
def test_other_targets_are_found(tmp_path, specimen, extent, pattern, values):
    shown = list(targets(extent, pattern))
    write(
        tmp_path, {"left/a{}.png": specimen, "right/a{}.png": specimen, "left/b{}.png": shown, "right/b{}.png": shown}
    )
    answer = dicflow("init", tmp_path)
    assert answer.code == 0, answer.err
    corners = stages(tmp_path)["corners"]
    assert corners.pop("marker", 0.7) == pytest.approx(0.7, abs=0.03)
    assert corners == {"stage": "corners", "images": "boards", **values}
    assert ("circles" in values.get("target", "")) == (
        "distance of neighbouring rows" in (tmp_path / "pipeline.yaml").read_text()
    )


def test_each_command_line_of_a_question_settles_it(tmp_path, specimen, boards):
    folder = write(tmp_path / "it's [1] $HOME `x` é日", {"Anna's/{}.png": specimen, "Bob [2]/{}.png": specimen,
                                     "Anna's/cal/{}.png": boards, "Bob [2]/cal/{}.png": boards})  # fmt: skip
    answer = dicflow("init", folder, "--square", "10 mm")
    assert answer.code == 2
    assert not (folder / "pipeline.yaml").exists()
    commands = [shlex.split(line) for line in answer.err.splitlines() if line.startswith("  dicflow init ")]
    expected = [  # left, right, boards of the left
        ("Anna's/*.png", "Bob [2]/*.png", "Anna's/cal/*.png"),
        ("Anna's/*.png", None, None),
        ("Bob [2]/*.png", None, None),
    ]
    for command, (left, right, rig) in zip(commands, expected, strict=True):
        again = dicflow(*command[1:])
        assert again.code == 0, again.err
        found = stages(folder)
        assert (found["photos"]["left"], found["photos"].get("right")) == (left, right)
        assert found.get("boards", {"left": None})["left"] == rig
        assert shlex.split(again.out.splitlines()[-1].split("then: ")[1]) == [
            "dicflow",
            "run",
            str(folder / "pipeline.yaml"),
        ]
        (folder / "pipeline.yaml").unlink()


@pytest.mark.slow
def test_options_name_folders_or_patterns(tmp_path, specimen, boards):
    folder = write(
        tmp_path, {"Anna/{}.png": specimen, "Bob/{}.png": specimen, "Anna/x/{}.png": boards, "Bob/x/{}.png": boards}
    )
    said: list[str] = []
    found = look(folder, Choice(("Anna",), ("Bob",)), [], said.append)
    assert (found.photos.left, found.photos.right) == (["Anna/*.png"], ["Bob/*.png"])
    assert found.boards is not None
    assert found.boards.right == ["Bob/x/*.png"]
    by_boards = look(folder, Choice(("Bob",), ("Anna",), ("*/x",)), [], said.append)
    assert (by_boards.photos.left, by_boards.boards and by_boards.boards.left) == (["Bob/*.png"], ["Bob/x/*.png"])
    dicflow("init", folder, "--left", "Carl").refuses(2, "--left Carl: matches no photograph in")
    dicflow("init", folder, "--left", "Anna", "--right", "Bob", "--boards", "Anna/1.png").refuses(
        2, "boards of one camera"
    )


def test_named_boards_without_a_board_are_refused(tmp_path, specimen):
    folder = write(tmp_path, {f"{name}/{side}/{{}}.png": specimen for name in ("a", "b") for side in ("left", "right")})
    with pytest.raises(
        InputError, match="no checkerboard, ChArUco board or grid of circles is recognised in 3 pairs, b/left"
    ):
        look(folder, Choice(boards=("b",)), [], str)


def test_one_camera_only_if_the_user_says_so(tmp_path, specimen):
    folder = write(tmp_path, {"left/{}.png": specimen, "right/{}.png": specimen})
    dicflow("init", folder).refuses(2, "two cameras, but no photographs of a board", "--one-camera")
    dicflow("init", folder, "--one-camera").refuses(2, "2 series of the specimen look alike")
    answer = dicflow("init", folder, "--one-camera", "--left", "right")
    assert answer.out.splitlines()[:2] == [
        "specimen: 3 photographs of one camera, right/*.png", "left out: 3 photographs, left/*.png"
    ]  # fmt: skip
    assert stages(folder)["total"]["points"] == "correlation"
    (axis,) = (line for line in answer.out.splitlines() if line.startswith("load along"))
    assert axis.startswith("load along x: +8.0 % along x, -2.0 % along y until step 3 of 3")
    ((x0, y0), (x1, y1)) = stages(folder)["probes"]["extensometers"]["along_load"]
    assert y0 == y1
    assert 30 <= x0 < 100 < 320 < x1 <= SIZE[0] - 30


def test_a_calibration_of_another_program_stands_in_for_boards(tmp_path, specimen):
    folder = write(tmp_path, {"left/{}.png": specimen, "right/{}.png": specimen, "Anna/{}.png": specimen})
    (folder / "a.xml").write_text("<no><calibration/></no>")
    matchid(folder / "rig.caldat", made_rig())
    answer = dicflow("init", folder)
    assert answer.code == 0, answer.err
    assert "calibration: rig.caldat" in answer.out
    found = stages(folder)
    assert found["rig"] == {"stage": "rig_file", "images": "photos", "file": "rig.caldat"}
    assert (found["photos"]["right"], found["total"]["points"]) == ("right/*.png", "points")


def test_which_way_up_is_said(tmp_path, specimen):
    exif = Image.Exif()
    exif[0x0112] = 6
    answer = dicflow("init", write(tmp_path, {"a{}.jpg": specimen}, exif=exif.tobytes()))
    assert f"measured as the sensor lies, {SIZE[0]} × {SIZE[1]} px" in answer.out


def test_hidden_files_results_and_what_is_no_photograph_are_passed_over(tmp_path, specimen):
    write(tmp_path, {"a{}.png": specimen, "results/p/maps/m{}.png": specimen, ".cache/c{}.png": specimen})
    for name in ("._a1.png", "notes.txt", "a4.dng"):
        (tmp_path / name).write_bytes(b"x")
    assert dicflow("init", tmp_path).out.splitlines()[0] == "specimen: 3 photographs of one camera, *.png"


def test_folders_are_looked_through_up_to_a_number_of_files(tmp_path, monkeypatch):
    monkeypatch.setattr("dicflow.start.folder.MOST_ENTRIES", 20)
    for k in range(21):
        (tmp_path / f"{k}.txt").touch()
    with pytest.raises(InputError, match="or 20 files and folders; name the folder of one test"):
        look(tmp_path, Choice(), [], lambda text: None)


@pytest.mark.skipif(os.name == "nt", reason="names are Unicode there")
def test_a_name_that_is_not_unicode_is_refused(tmp_path, specimen):
    write(tmp_path, {"a{}.png": specimen})
    os.mkdir(os.fsencode(tmp_path) + b"/x\xff")
    shutil.copy(tmp_path / "a1.png", os.fsencode(tmp_path) + b"/x\xff/1.png")
    dicflow("init", tmp_path).refuses(2, "'x\\udcff/1.png': the name is not Unicode; rename it")


def test_photographs_that_cannot_be_read_do_not_stop_the_rest(tmp_path, specimen):
    write(tmp_path, {"a{}.png": specimen})
    (tmp_path / "old").mkdir()
    for k in range(3):
        (tmp_path / "old" / f"x{k}.png").write_bytes(b"damaged")
    answer = dicflow("init", tmp_path)
    assert answer.out.splitlines()[1] == "left out: 3 photographs, old/*.png: cannot be read"


def test_pages_of_two_stacks_are_steps(tmp_path, specimen, boards):
    for name, shown in (("test", specimen), ("cal", boards)):
        for side in ("left", "right"):
            first, *rest = (Image.fromarray(np.asarray(one, dtype=np.uint8)) for one in shown)
            first.save(tmp_path / f"{name}_{side}.tif", save_all=True, append_images=rest)
    answer = dicflow("init", tmp_path, "--square", "10 mm")
    assert answer.out.splitlines()[:2] == [
        f"specimen: {STEPS} pairs, test_left.tif and test_right.tif",
        f"boards: {BOARDS} pairs, cal_left.tif and cal_right.tif, a checkerboard of 7 × 5 inner corners",
    ]


@pytest.mark.slow
def test_a_real_specimen(shared_data):
    """A steel part pulled along x, whose left and right names differ in a suffix, and boards of 12 × 8 corners."""
    found = look(shared_data / "d_specimen", Choice(), [], str)
    assert (found.photos.left, found.photos.right, len(found.photos.steps)) == (["left/*.tif"], ["right/*.tif"], 7)
    assert found.boards is not None
    assert found.boards.left == ["boards/left/*.jpeg"]
    assert found.board == Board("checkerboard", (12, 8))
    assert found.gauge is not None
    assert found.gauge.axis == "x"
    assert found.gauge.reason.endswith("until step 7 of 7")
