"""Which series the two cameras took, by names alone: as people name folders and files."""

from __future__ import annotations

from pathlib import PurePosixPath

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.start.choice import Candidate, Choice, Undecided, decide, is_named
from dicflow.start.layouts import Series, series_of, step_folders
from dicflow.start.patterns import patterns_of

pytestmark = pytest.mark.slow

STEPS, BOARDS = 6, 10

LAYOUTS = [
    # specimen left, specimen right, boards left, boards right
    ("photos/left/{:02}.png", "photos/right/{:02}.png", "boards/left/{:02}.png", "boards/right/{:02}.png"),
    ("left/test/{}.png", "right/test/{}.png", "left/boards/{}.png", "right/boards/{}.png"),
    ("LEFT/Test/{}.PNG", "RIGHT/Test/{}.PNG", "LEFT/Boards/{}.PNG", "RIGHT/Boards/{}.PNG"),
    ("Phone 1/test/IMG_{}.JPG", "Phone 2/test/IMG_{}.JPG", "Phone 1/cal/IMG_{}.JPG", "Phone 2/cal/IMG_{}.JPG"),
    ("Kamera A/Zug/{}.tif", "Kamera B/Zug/{}.tif", "Kamera A/Tafel/{}.tif", "Kamera B/Tafel/{}.tif"),
    ("cam0/t{}.bmp", "cam1/t{}.bmp", "boards/cam0/{}.bmp", "boards/cam1/{}.bmp"),
    ("CAM_A/{}.png", "CAM_B/{}.png", "calibration/CAM_A/{}.png", "calibration/CAM_B/{}.png"),
    ("test_left/{}.tif", "test_right/{}.tif", "calib_left/{}.tif", "calib_right/{}.tif"),
    ("test_left_{}.tif", "test_right_{}.tif", "calib_left_{}.tif", "calib_right_{}.tif"),
    ("leftTest{:03}.tif", "rightTest{:03}.tif", "leftCalib{:03}.tif", "rightCalib{:03}.tif"),
    ("test/ImageLeft{}.png", "test/ImageRight{}.png", "board/ImageLeft{}.png", "board/ImageRight{}.png"),
    ("t{:02}_0.tif", "t{:02}_1.tif", "board{:02}_0.tif", "board{:02}_1.tif"),
    ("test/{:04}-1.tif", "test/{:04}-2.tif", "cal/{:04}-1.tif", "cal/{:04}-2.tif"),
    ("t{:02}_L.tif", "t{:02}_R.tif", "board{:02}_L.tif", "board{:02}_R.tif"),
    ("t{:02}l.jpg", "t{:02}r.jpg", "board{:02}l.jpg", "board{:02}r.jpg"),
    ("test/L{:03}.tif", "test/R{:03}.tif", "boards/L{:03}.tif", "boards/R{:03}.tif"),
    ("DIC/cam_0_frame_{}.png", "DIC/cam_1_frame_{}.png", "cal/cam_0_frame_{}.png", "cal/cam_1_frame_{}.png"),
    ("links/zug{}.png", "rechts/zug{}.png", "brett/links/{}.png", "brett/rechts/{}.png"),
    ("gauche/essai{}.png", "droite/essai{}.png", "mire gauche/{}.png", "mire droite/{}.png"),
    ("ensayo/izquierda/{}.png", "ensayo/derecha/{}.png", "damero/izquierda/{}.png", "damero/derecha/{}.png"),
    ("Prova/SINISTRA/{}.png", "Prova/DESTRA/{}.png", "Scacchiera/SINISTRA/{}.png", "Scacchiera/DESTRA/{}.png"),
    ("esquerda/{}.png", "direita/{}.png", "tabuleiro/esquerda/{}.png", "tabuleiro/direita/{}.png"),
    ("vänster/{}.png", "höger/{}.png", "kalibrering/vänster/{}.png", "kalibrering/höger/{}.png"),
    ("левая/{}.png", "правая/{}.png", "доска/левая/{}.png", "доска/правая/{}.png"),
    ("左相机/{}.png", "右相机/{}.png", "标定/左相机/{}.png", "标定/右相机/{}.png"),
    ("master/{}.tif", "slave/{}.tif", "master/cal/{}.tif", "slave/cal/{}.tif"),
    ("A/test/{}.tif", "B/test/{}.tif", "A/boards/{}.tif", "B/boards/{}.tif"),
    ("1/test/{}.tif", "2/test/{}.tif", "1/boards/{}.tif", "2/boards/{}.tif"),
    ("test_A_{}.png", "test_B_{}.png", "cal_A_{}.png", "cal_B_{}.png"),
    ("test_0_{:03}.png", "test_1_{:03}.png", "cal_0_{:03}.png", "cal_1_{:03}.png"),
    ("Ensayo izda ({}).jpg", "Ensayo dcha ({}).jpg", "Patrón izda ({}).jpg", "Patrón dcha ({}).jpg"),
    ("cam_one/{}.png", "cam_two/{}.png", "cam_one/cal/{}.png", "cam_two/cal/{}.png"),
    ("First Camera/{}.png", "Second Camera/{}.png", "cal/First Camera/{}.png", "cal/Second Camera/{}.png"),
    ("l{:03}.png", "r{:03}.png", "boardl{:03}.png", "boardr{:03}.png"),
    ("sys1-{:04}_0.tif", "sys1-{:04}_1.tif", "sys1-cal-{:03}_0.tif", "sys1-cal-{:03}_1.tif"),
    ("t/ace_22334455_{}.tif", "t/ace_22334477_{}.tif", "c/ace_22334455_{}.tif", "c/ace_22334477_{}.tif"),
    ("top/{}.png", "bottom/{}.png", "top/cal/{}.png", "bottom/cal/{}.png"),
    ("iPhone 12/IMG_{}.JPG", "iPhone 13/IMG_{}.JPG", "cal/iPhone 12/IMG_{}.JPG", "cal/iPhone 13/IMG_{}.JPG"),
    ("iPhone 12 Pro/IMG_{}.jpg", "Pixel 7a/PXL_{}.jpg", "iPhone 12 Pro/cal/IMG_{}.jpg", "Pixel 7a/cal/PXL_{}.jpg"),
    ("GoPro1/GOPR{:04}.JPG", "GoPro2/GOPR{:04}.JPG", "GoPro1/cal/GOPR{:04}.JPG", "GoPro2/cal/GOPR{:04}.JPG"),
    ("left/DSC_{:04}.JPG", "right/IMG_{:04}.JPG", "left/cal/DSC_{:04}.JPG", "right/cal/IMG_{:04}.JPG"),
    ("L/left_{}.png", "R/right_{}.png", "cal/L/left_{}.png", "cal/R/right_{}.png"),
    ("leftcam/{}.png", "rightcam/{}.png", "leftcam/cal/{}.png", "rightcam/cal/{}.png"),
    ("left camera/{}.png", "Right/{}.png", "cal/left camera/{}.png", "cal/Right/{}.png"),
    ("cam1_left/{}.png", "cam2_right/{}.png", "cal/cam1_left/{}.png", "cal/cam2_right/{}.png"),
    ("Cam_21284923/{}.tif", "Cam_21284930/{}.tif", "cal/Cam_21284923/{}.tif", "cal/Cam_21284930/{}.tif"),
    ("t/21284923_{:04}.tif", "t/21284930_{:04}.tif", "cal/21284923_{:04}.tif", "cal/21284930_{:04}.tif"),
    ("11-27/raw/left/x{}.png", "11-27/raw/right/x{}.png", "11-27/cal/left/{}.png", "11-27/cal/right/{}.png"),
    ("a/b/c/d/left/{}.png", "a/b/c/d/right/{}.png", "a/b/c/cal/left/{}.png", "a/b/c/cal/right/{}.png"),
    ("photos [1]/left/{}.png", "photos [1]/right/{}.png", "cal [1]/left/{}.png", "cal [1]/right/{}.png"),
]  # fmt: skip

STRANGERS = [
    "setup.jpg", "notes/setup.jpg", "figures/fig{}.png", "left/roi.tif", "photos/left/mask.png", "microscope/{}.tif",
    "boards/left/old/blurred {}.png", "test/overview.png",
]  # fmt: skip


def paths_of(patterns, steps=STEPS, boards=BOARDS):
    counts = (steps, steps, boards, boards)
    return [PurePosixPath(one.format(k)) for one, count in zip(patterns, counts, strict=True) for k in range(count)]


def chosen(paths, boards, choice=Choice()):  # noqa: B008
    """The choice among series, of which those with a file in ``boards`` show boards."""
    series = series_of(paths)
    shown = [one for one in series if set(one.files) & set(boards)]
    return decide([one for one in series if one not in shown], shown, choice)


def files(candidate: Candidate):
    assert candidate.right is not None
    assert candidate.boards is not None
    return [list(one.files) for one in (candidate.left, candidate.right, candidate.boards.left, candidate.boards.right)]


@pytest.mark.parametrize("layout", LAYOUTS, ids=[row[0] for row in LAYOUTS])
def test_two_cameras_are_found(layout):
    paths = paths_of(layout)
    n = 2 * STEPS
    expected = [paths[:STEPS], paths[STEPS:n], paths[n : n + BOARDS], paths[n + BOARDS :]]
    assert files(chosen(paths, paths[n:])) == expected


@pytest.mark.parametrize(
    ("patterns", "why"),
    [
        (
            ("Anna/{}.png", "Bob/{}.png", "Anna/cal/{}.png", "Bob/cal/{}.png"),
            "2 series of the specimen look alike (6, 6",
        ),
        (("front/{}.png", "side/{}.png", "cal/left/{}.png", "cal/right/{}.png"), "2 series of the specimen look alike"),
        (("day 1/{}.png", "day 2/{}.png", "day 1/cal/{}.png", "day 2/cal/{}.png"), "the names do not say"),
        (("run_1_{}.png", "run_2_{}.png", "cal/left/{}.png", "cal/right/{}.png"), "the names do not say"),
        (("test1/{}.png", "test2/{}.png", "cal/A/{}.png", "cal/B/{}.png"), "the names do not say"),
        (("2026-11-01/{}.png", "2026-11-02/{}.png", "2026-11-01/cal/{}.png", "2026-11-02/cal/{}.png"), "the names do"),
        (("left/{}.png", "right/{}.png", "cal/cam1/{}.png", "cal/cam2/{}.png"), "the names do not say"),
        (("top/{}.png", "bottom/{}.png", "cal/left/{}.png", "cal/right/{}.png"), "the names do not say"),
        (("test 1/{}.png", "test 2/{}.png", "cal 1/t{}.png", "cal 2/t{}.png"), "the names do not say"),
        (("load_{}.png", "unload_{}.png", "cal/left/{}.png", "cal/right/{}.png"), "2 series of the specimen look"),
        (("left/{}.png", "right/{}.png", "cal/Anna/{}.png", "cal/Bob/{}.png"), "2 pairs of series of the boards"),
    ],
)
def test_two_series_alike_are_never_taken_for_one_camera(patterns, why):
    """Where names leave a doubt, each answer is offered: two cameras first, and each series alone."""
    paths = paths_of(patterns)
    with pytest.raises(Undecided) as caught:
        chosen(paths, paths[2 * STEPS :])
    assert caught.value.reason.startswith(why)
    offered = caught.value.candidates
    assert offered[0].right is not None
    assert {offered[0].left.files, offered[0].right.files} == {tuple(paths[:STEPS]), tuple(paths[STEPS : 2 * STEPS])}
    assert {one.left.files for one in offered if one.right is None} == {tuple(paths[:6]), tuple(paths[6:12])}
    for candidate in offered:
        assert decide_again(paths, paths[2 * STEPS :], candidate) == candidate


def decide_again(paths, boards, candidate):
    """The choice after the answer that names a candidate."""
    named = [[*map(str, candidate.left.files)], [*map(str, candidate.right.files if candidate.right else ())]]
    if candidate.boards:
        named = [[*one, *map(str, two.files)] for one, two in zip(named, candidate.boards[:2], strict=True)]
    answer = Choice(tuple(named[0]), tuple(named[1]), one_camera=candidate.right is None)
    again = chosen(paths, boards, answer)
    rig = again.boards and again.boards[:2]
    assert rig == (candidate.boards and candidate.boards[:2])
    return again._replace(boards=candidate.boards)


@pytest.mark.parametrize("count", [0, 1])
def test_two_cameras_need_the_boards_of_both(count):
    paths = paths_of(("left/{}.png", "right/{}.png", "cal/left/{}.png", "cal/right/{}.png"))[
        : 2 * STEPS + count * BOARDS
    ]
    with pytest.raises(Undecided, match=["no photographs of a board", "boards of one camera only"][count]) as caught:
        chosen(paths, paths[2 * STEPS :])
    assert caught.value.candidates[0].boards is None


def test_boards_of_two_cameras_do_not_go_with_one_series():
    paths = [
        PurePosixPath(one.format(k)) for one in ("test/{}.png", "cal/left/{}.png", "cal/right/{}.png") for k in range(9)
    ]
    with pytest.raises(Undecided, match="boards of two cameras, but one series of the specimen"):
        chosen(paths, paths[9:])
    assert chosen(paths, paths[9:], Choice(one_camera=True)).left.files == tuple(paths[:9])


@pytest.mark.parametrize(
    "pattern",
    [
        "img_{:04}.png",
        "left/{}.png",
        "ut_2{:02}.tif",
        "cam_{:04}.png",
        "A00{} C0 R0.tif",
        "frame 10-59-{}.png",
        "t_1_{}.png",
    ],
)
def test_one_series_is_one_camera(pattern):
    """Also where a letter or number in its names would be a camera's if there were another one."""
    paths = [PurePosixPath(pattern.format(k)) for k in range(5)]
    assert chosen(paths, []).left.files == tuple(paths)
    boards = [PurePosixPath(f"calib/{k}.png") for k in range(9)]
    assert chosen([*paths, *boards], boards, Choice(one_camera=True)) == Candidate(series_of(paths)[0])
    assert chosen([*paths, *boards[:2]], boards) == Candidate(series_of(paths)[0])


def test_the_longest_of_several_tests_is_measured_and_equal_ones_are_offered():
    static = paths_of(("static/left/{}.png", "static/right/{}.png", "cal/left/{}.png", "cal/right/{}.png"), steps=3)
    test = paths_of(("test/left/{}.png", "test/right/{}.png", "x", "x"), boards=0)
    found = chosen([*static, *test], static[6:])
    assert found.left.files == tuple(test[:STEPS])
    again = paths_of(("again/left/{}.png", "again/right/{}.png", "x", "x"), boards=0)
    with pytest.raises(Undecided, match="2 pairs of series of the specimen look alike") as caught:
        chosen([*static, *test, *again], static[6:])
    assert [one.left.files[0].parts[0] for one in caught.value.candidates[:2]] == ["again", "test"]


def test_boards_of_the_same_day_go_with_a_test():
    rows = [(f"{day}/left/{{}}.png", f"{day}/right/{{}}.png", f"{day}/cal/left/{{}}.png", f"{day}/cal/right/{{}}.png")
            for day in ("monday", "tuesday")]  # fmt: skip
    monday, tuesday = paths_of(rows[0], steps=4), paths_of(rows[1], steps=12)
    found = chosen([*monday, *tuesday], [*monday[8:], *tuesday[24:]])
    assert {str(one[0]).split("/")[0] for one in files(found)} == {"tuesday"}


def test_a_missing_photograph_does_not_join_the_cameras():
    paths = [PurePosixPath(f"s{k:02}_{camera}.png") for k in range(12) for camera in (0, 1) if (k, camera) != (5, 1)]
    assert [len(one.files) for one in series_of(paths)] == [12, 11]


def test_the_first_photograph_may_have_a_name_of_its_own():
    paths = [PurePosixPath(f"test/{name}.png") for name in ("Reference", "load 1", "load 2", "load 10", "roi")]
    assert [one.files for one in series_of(paths)] == [tuple(paths[:4])]
    assert patterns_of(paths[:4], paths) == ["test/Reference.png", "test/load *.png"]
    named = [PurePosixPath(f"wave_{name}.tif") for name in ("Deformed", "Reference")]
    assert series_of(named)[0].files == (named[1], named[0])
    assert patterns_of((named[1], named[0]), named) == ["wave_Reference.tif", "wave_Deformed.tif"]


def test_of_copies_in_two_formats_the_better_one_is_measured():
    paths = [PurePosixPath(f"left/{k}{end}") for k in range(3) for end in (".jpg", ".TIF")]
    (series,) = series_of(paths)
    assert series.files == tuple(paths[1::2])
    assert patterns_of(series.files, paths) == ["left/*.TIF"]


def test_a_folder_for_each_step_is_recognised():
    paths = [PurePosixPath(f"test {k}/{side}.png") for k in range(4) for side in ("left", "right")]
    assert len(step_folders(series_of(paths))) == 4
    assert not step_folders(
        series_of([PurePosixPath(f"{name}/{k}.png") for name in ("a1", "a2", "a3") for k in (1, 2)])
    )


@settings(max_examples=60)
@given(st.sampled_from(LAYOUTS), st.randoms(use_true_random=False), st.sets(st.sampled_from(STRANGERS)))
def test_neither_the_order_nor_other_files_change_what_is_found(layout, random, strangers):
    paths = paths_of(layout)
    others = [PurePosixPath(name.format(k)) for name in strangers for k in range(3)]
    shuffled = [*paths, *others]
    random.shuffle(shuffled)
    found = chosen(shuffled, paths[2 * STEPS :])
    assert files(found) == files(chosen(paths, paths[2 * STEPS :]))


@settings(max_examples=60)
@given(st.sampled_from(LAYOUTS), st.sets(st.sampled_from(STRANGERS)))
def test_patterns_find_the_files_of_a_series_and_no_others(layout, strangers):
    paths = [*paths_of(layout), *(PurePosixPath(name.format(k)) for name in strangers for k in range(3))]
    assert set(paths_of(layout)) <= {path for series in series_of(paths) for path in series.files}
    for series in series_of(paths):
        patterns = patterns_of(series.files, paths)
        assert [path for path in sorted(set(paths)) if is_named(path, patterns)] == sorted(series.files)


@settings(max_examples=200)
@given(st.lists(st.text(min_size=1, max_size=12).filter(lambda name: "/" not in name and name.strip(".")), min_size=1))
def test_any_names_make_series(names):
    """No name is an error, no photograph is in two series, and patterns read back names with any signs."""
    paths = list(dict.fromkeys(PurePosixPath("a", f"{name}.png") for name in names))
    found = [path for series in series_of(paths) for path in series.files]
    assert len(found) == len(set(found))
    assert set(found) <= set(paths)
    for series in series_of(paths):
        patterns = patterns_of(series.files, paths)
        assert {path for path in paths if is_named(path, patterns)} == set(series.files)


def test_series_of_the_same_name_are_compared_by_their_words():
    one, other = series_of([PurePosixPath("Left/IMG_1.png"), PurePosixPath("right/IMG_1.png")])
    assert one == Series((PurePosixPath("Left/IMG_1.png"),), (("left",), ("img", "#")))
    assert one.words == {"left", "img", "#"}
    assert other.folder == PurePosixPath("right")
