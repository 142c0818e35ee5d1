from pathlib import Path

import cv2
import numpy as np
import pytest

from dicflow.core.cameras.camera import project
from dicflow.core.synthetic.deformation import position
from dicflow.core.synthetic.render import Extent, extent_outline
from dicflow.core.synthetic.stand import in_right_frame
from dicflow.core.synthetic.trace import image_of
from dicflow.io.caliper import read_caliper
from dicflow.io.region import read_geojson
from dicflow.io.rig import read_rig
from dicflow.kinds.rig import rig_to_json
from dicflow.synth import latex_experiment, sample_experiment, write_experiment
from dicflow.synth.folder import photographs, take
from dicflow.synth.rubber import write_rubber
from dicflow.synth.truth import field_truth, length_rows

pytestmark = pytest.mark.slow

SAMPLES = Path(__file__).resolve().parents[1] / "data_samples"


@pytest.fixture(scope="module")
def experiments():
    return {number: latex_experiment(number, boards=2) for number in range(1, 6)}


@pytest.fixture(scope="module")
def small():
    return latex_experiment(3, scale=0.2, steps=(0, 5), boards=2)


@pytest.fixture(scope="module")
def folder(small, tmp_path_factory):
    path = tmp_path_factory.mktemp("synth") / "small"
    write_experiment(path, small)
    return path


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.slow
def test_the_five_tests_have_their_84_steps_and_lengths(experiments):
    caliper = [experiments[number].caliper for number in range(1, 6)]
    assert [len(c.length_mm) for c in caliper] == [22, 22, 22, 12, 6]
    assert [c.length_mm[0] for c in caliper] == [59.95, 60.05, 60.0, 60.35, 19.35]
    assert [c.length_mm.max() for c in caliper] == [131.5, 137.45, 122.85, 83.0, 28.8]
    assert [c.load_g[-1] for c in caliper] == [68.53, 68.53, 68.53, 268.53, 868.53]


def test_every_length_is_imposed_exactly(experiments):
    rows = np.concatenate([length_rows(experiments[number]) for number in range(1, 6)])
    imposed, chord, along_y = rows.T
    assert len(rows) == 84
    assert chord == pytest.approx(imposed, rel=1e-12)
    assert along_y == pytest.approx(imposed, rel=2e-4)


@pytest.mark.parametrize("number", range(1, 6))
def test_the_whole_strip_is_in_both_photographs_at_every_step(experiments, number):
    experiment = experiments[number]
    rig, margin = experiment.stand.rig, 20.0
    for state in experiment.deformations:
        half = state.width / 2.0
        edge = extent_outline(Extent(-half, half, -experiment.overhang, state.length + experiment.overhang))
        for camera, seen in ((rig.left, state), (rig.right, in_right_frame(rig, state))):
            pixels = image_of(camera, seen, edge)
            assert camera.size == (1440, 1920)
            assert (pixels > margin).all()
            assert (pixels < np.array(camera.size) - margin).all()


def test_the_strip_stretches_unevenly_and_leaves_its_plane(experiments):
    truth = field_truth(experiments[1])
    peak = int(np.argmax(experiments[1].caliper.length_mm))
    assert np.ptp(truth["eyy"][peak]) > 0.1
    assert truth["eyy"][peak].mean() == pytest.approx(1.1935, abs=0.01)
    assert 0.3 < np.ptp(truth["xyz"][peak, :, 10, 2]) < 3.0
    assert np.abs(truth["gxy"][peak]).max() > 0.002


def test_there_are_only_five_tests():
    with pytest.raises(ValueError, match="1 to 5"):
        latex_experiment(6)


def test_the_sample_stretches_to_twice_its_length_in_small_steps():
    lengths = sample_experiment(boards=1).caliper.length_mm
    ratios = lengths[1:] / lengths[:-1]
    assert lengths.max() / lengths[0] > 2.0
    assert ratios.max() <= 1.25
    assert ratios.min() >= 1.0 / 1.25
    assert lengths[-1] < lengths.max()


def test_the_folder_holds_what_a_user_would_bring(folder, small):
    assert read_caliper(folder / "caliper.csv").length_mm.tolist() == [60.0, 82.05]
    assert rig_to_json(read_rig(folder / "truth" / "rig.json")) == rig_to_json(small.stand.rig)
    for side in ("left", "right"):
        assert [p.name for p in sorted((folder / "photos" / side).iterdir())] == ["step_00.png", "step_01.png"]
        assert [p.name for p in sorted((folder / "boards" / side).iterdir())] == ["board_00.png", "board_01.png"]
    assert cv2.imread(str(folder / "photos/left/step_00.png"), cv2.IMREAD_UNCHANGED).shape == (384, 288)


def test_the_region_outlines_the_speckles(folder, small):
    (region,) = read_geojson(folder / "region.geojson").polygons
    image = cv2.imread(str(folder / "photos/left/step_00.png"), cv2.IMREAD_GRAYSCALE)
    mask = cv2.fillPoly(np.zeros_like(image), [np.rint(region.exterior).astype(np.int32)], 1) > 0
    assert image[cv2.erode(mask.astype(np.uint8), np.ones((3, 3))) > 0].std() > 40.0
    ring = cv2.dilate(mask.astype(np.uint8), np.ones((5, 1))) - mask
    above = ring[: int(region.exterior[:, 1].mean())]
    assert image[: len(above)][above > 0].mean() > 140.0


def test_truth_is_consistent(folder, small):
    truth = np.load(folder / "truth" / "fields.npz")
    state, rig = small.deformations[1], small.stand.rig
    assert truth["xyz"].shape == (2, 61, 21, 3)
    assert truth["xyz"][1] == pytest.approx(position(state, truth["material"]), abs=1e-12)
    assert truth["left_px"][1] == pytest.approx(project(rig.left, truth["xyz"][1]), abs=1e-9)
    in_right = truth["xyz"][1] @ rig.rotation.T + rig.translation
    assert truth["right_px"][1] == pytest.approx(project(rig.right, in_right), abs=1e-9)
    assert max(np.abs(truth[name][0]).max() for name in ("exx", "eyy", "gxy")) < 1e-12


def test_the_same_bytes_again_with_two_workers(folder, small, tmp_path):
    names = []
    write_experiment(
        tmp_path, small, workers=2, on_progress=lambda done, total, name: names.append((done, total, name))
    )
    assert contents(tmp_path) == contents(folder)
    assert [done for done, _, _ in names] == list(range(1, 9))
    assert {name for _, _, name in names} == {picture.name for picture in photographs(small)}


def test_photographs_of_an_earlier_experiment_are_removed(small, tmp_path):
    stray = tmp_path / "photos" / "left" / "step_07.png"
    kept = tmp_path / "photos" / "left" / "notes.txt"
    stray.parent.mkdir(parents=True)
    stray.write_bytes(b"")
    kept.write_text("mine")
    write_experiment(
        tmp_path,
        small._replace(deformations=small.deformations[:1], poses=small.poses[:1], caliper=read_caliper_row(small)),
    )
    assert not stray.exists()
    assert kept.exists()


def read_caliper_row(experiment):
    caliper = experiment.caliper
    return caliper._replace(phase=caliper.phase[:1], load_g=caliper.load_g[:1], length_mm=caliper.length_mm[:1])


@pytest.fixture(scope="module")
def sample():
    return sample_experiment()


@pytest.mark.parametrize("name", ["photos/left/step_04.png", "boards/right/board_07.png"])
def test_the_samples_are_what_the_command_makes(sample, name):
    (picture,) = (each for each in photographs(sample) if each.name == name)
    assert np.array_equal(take(sample, picture), cv2.imread(str(SAMPLES / name), cv2.IMREAD_UNCHANGED))


def test_the_samples_boards_show_their_true_corners():
    truth = np.load(SAMPLES / "truth" / "boards.npz")["left"]
    assert truth.shape == (12, 6, 9, 2)
    for pair in (0, 5):
        image = cv2.imread(str(SAMPLES / "boards" / "left" / f"board_{pair:02d}.png"), cv2.IMREAD_GRAYSCALE)
        found, corners = cv2.findChessboardCornersSB(image, (9, 6), flags=cv2.CALIB_CB_ACCURACY)
        assert found
        apart = np.linalg.norm(corners.reshape(-1, 1, 2) - truth[pair].reshape(-1, 2), axis=-1).min(axis=1)
        assert apart.mean() < 0.04


def test_the_rubber_is_what_the_command_makes(tmp_path):
    write_rubber(tmp_path)
    assert contents(tmp_path) == contents(SAMPLES / "rubber")


def test_the_samples_are_complete():
    assert (
        read_caliper(SAMPLES / "caliper.csv").length_mm.tolist()
        == sample_experiment(boards=1).caliper.length_mm.tolist()
    )
    assert sum(p.stat().st_size for p in SAMPLES.rglob("*") if p.is_file()) < 20e6
    assert len(list(SAMPLES.rglob("*.png"))) == 40
