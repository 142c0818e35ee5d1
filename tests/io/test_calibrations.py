import re
import subprocess
import sys
import zipfile

import cv2
import numpy as np
import pytest
from calibration_files import (
    FILES,
    SIZE,
    angles_deg,
    dice,
    made_rig,
    matchid,
    matlab,
    opencorr,
    vic3d_xml,
    zipped,
)
from scipy.io import savemat

from dicflow.core.cameras.camera import Rig, project, rotation_angle_deg, to_right, undistort
from dicflow.errors import InputError
from dicflow.io.calibrations import FORMATS, calibration_modules
from dicflow.io.calibrations.draft import Source
from dicflow.io.calibrations.opencv import opencv_text, write_opencv
from dicflow.io.calibrations.read import parse_calibration, read_calibration
from dicflow.kinds.rig import rig_to_json


def close(rig: Rig, truth: Rig, digits: float = 1e-11) -> None:
    """Every number of two rigs agrees to the digits of a file with 16."""
    for one, other in ((rig.left, truth.left), (rig.right, truth.right)):
        np.testing.assert_allclose(one.matrix, other.matrix, rtol=digits)
        np.testing.assert_allclose(one.distortion, other.distortion, rtol=digits)
        assert one.size == other.size
    np.testing.assert_allclose(rig.rotation, truth.rotation, atol=digits)
    np.testing.assert_allclose(rig.translation, truth.translation, rtol=100 * digits)


def refused(path, *words, size=SIZE):
    """The one message of a file that is refused holds its name and all these words."""
    with pytest.raises(InputError) as caught:
        read_calibration(path, size)
    assert str(path) in str(caught.value)
    for word in words:
        assert word in str(caught.value), caught.value


@pytest.mark.parametrize("name", FILES)
def test_one_rig_reads_back_from_every_format(tmp_path, name):
    truth = made_rig(tangential="vic3d" not in name)
    FILES[name](tmp_path / name, truth)
    close(read_calibration(tmp_path / name, SIZE).rig, truth)


@pytest.mark.parametrize("name", FILES)
def test_a_format_is_known_by_what_the_file_holds(tmp_path, name):
    truth = made_rig(tangential=False)
    FILES[name](tmp_path / "cal.dat", truth)
    close(read_calibration(tmp_path / "cal.dat", SIZE).rig, truth)


@pytest.mark.parametrize("name", ["opencv.yaml", "dicflow.json", "dice.xml", "matlab.mat"])
def test_formats_that_say_the_size_of_the_photographs(tmp_path, name):
    FILES[name](tmp_path / name, made_rig())
    assert read_calibration(tmp_path / name).rig.left.size == SIZE
    refused(tmp_path / name, "left camera", "1440 × 1080 px", "0.5 times", "720 × 540", size=(720, 540))
    refused(tmp_path / name, "1440 × 1080 px", "these have 1000 × 1000 px", size=(1000, 1000))


@pytest.mark.parametrize("name", ["matchid.caldat", "pyvale.csv", "opencorr.csv", "vic3d.xml", "vic3d.z3d"])
def test_formats_that_do_not_say_it(tmp_path, name):
    FILES[name](tmp_path / name, made_rig(tangential=False))
    assert parse_calibration(tmp_path / name).left.size is None
    refused(tmp_path / name, "size of the photographs", "'images'", size=None)
    refused(tmp_path / name, "principal point outside", "640 × 480", "about 1404 × 1107 px", size=(640, 480))
    warnings = read_calibration(tmp_path / name, (900, 900)).warnings
    assert "far from the middle of photographs of 900 × 900 px" in warnings[-1]


def test_matchid_in_all_its_dialects(tmp_path):
    truth = made_rig()
    for number, line in enumerate(
        (
            "{name}\t{value!r}",
            "{name} {value!r}",
            "{name},{value!r}",
            "'{name} {unit}': {value!r}",
            "  {name} {unit} = {value!r};",
            "{name} {unit}; {value!r}\n",
        )
    ):
        path = tmp_path / f"{number}.caldat"
        matchid(path, truth, line)
        close(read_calibration(path, SIZE).rig, truth)
    changes = {
        "lower": str.lower,
        "joined": lambda text: text.replace("Kappa ", "Kappa"),
        "from_1": lambda text: text.replace("Cam1_", "Cam2_").replace("Cam0_", "Cam1_"),
        "comma": lambda text: text.replace(".", ","),
        "utf16": lambda text: text,
        "remark": lambda text: "MatchID calibration of 3 May\n# made by hand\n\n" + text,
    }
    matchid(tmp_path / "plain.caldat", truth)
    plain = (tmp_path / "plain.caldat").read_text()
    for name, change in changes.items():
        path = tmp_path / f"{name}.caldat"
        path.write_text(change(plain), encoding="utf-16" if name == "utf16" else "utf-8")
        close(read_calibration(path, SIZE).rig, truth)


def test_matchid_in_other_units(tmp_path):
    truth, path = made_rig(), tmp_path / "m.caldat"
    matchid(path, truth)
    angle, shift = angles_deg(truth.rotation)[1], truth.translation[0]
    text = path.read_text().replace(f"Phi [deg];{angle!r}", f"Phi [rad];{float(np.radians(angle))!r}")
    path.write_text(text.replace(f"Tx [mm];{float(shift)!r}", f"Tx [m];{float(shift) / 1000!r}"))
    close(read_calibration(path, SIZE).rig, truth)
    path.write_text(text.replace("Ty [mm]", "Ty [inch]"))
    refused(path, ":22", "unit is 'inch'", "expected mm")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("Cam0_Fx [pixels];2898.5512345", "Cam0_Fx [pixels];", (":1:", "expected a name and a number")),
        ("Cam0_Fx [pixels];2898.5512345\n", "", ("MatchID", "Cam0_fx is missing")),
        ("Phi [deg]", "Chi [deg]", ("phi is missing",)),
        ("Cam1_P1", "Cam1_P2", ("line", "leave out one")),
        ("Cam0_Kappa 3 ;0.317", "Cam0_Kappa 4 ;0.317", (":6", "kappa4 = 0.317", "k1, k2, k3")),
        ("Cam1_", "Camera_", ("1 camera(s)", "pair")),
        ("Cam0_Fx [pixels];2898.5512345", "Cam0_Fx [pixels];-5", ("left camera", "-5", "positive")),
        ("Cam0_Fx [pixels];2898.5512345", "Cam0_Fx [pixels];1e999", (":1", "1e999", "1,000,000,000")),
    ],
)
def test_what_is_wrong_with_a_matchid_file(tmp_path, old, new, words):
    path = tmp_path / "m.caldat"
    matchid(path, made_rig())
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    refused(path, *words)


def test_opencorr_turns_by_a_vector_in_radians(tmp_path):
    """The published numbers of a rig whose rotation OpenCorr gives as Rodrigues' vector."""
    path = tmp_path / "o.csv"
    opencorr(path, made_rig())
    text = path.read_text().splitlines()
    turn = {"Rx": 0.00307711, "Ry": -0.33278773, "Rz": 0.00524556}
    path.write_text("\n".join(f"{line[:2]},0,{turn[line[:2]]}" if line[:2] in turn else line for line in text))
    found = read_calibration(path, SIZE)
    np.testing.assert_allclose(found.rig.rotation[0], [0.94512186, -0.00565654, -0.32666905], atol=1e-8)
    assert not found.warnings
    opencorr(path, made_rig(), degrees=True)
    assert "degrees" in read_calibration(path, SIZE).warnings[0]


def test_what_is_wrong_with_an_opencorr_file(tmp_path):
    path = tmp_path / "o.csv"
    opencorr(path, made_rig())
    text = path.read_text()
    path.write_text(text.replace("K4,0.0,0.0", "K4,0.0,0.3"))
    refused(path, "k4 = 0.3")
    path.write_text(text.replace("K1,-0.1123456789,", "K1,abc,"))
    refused(path, ":7", "K1 is 'abc'")
    path.write_text(text.replace("Tz,", "Q,"))
    refused(path, "tz is missing")
    path.write_text(text.replace("Cx,701.32,", "Cx,"))
    refused(path, "Cx has 1 value(s)")


def test_opencv_reads_what_is_written_for_it(tmp_path):
    truth = made_rig()
    write_opencv(tmp_path / "rig.yaml", truth)
    storage = cv2.FileStorage(str(tmp_path / "rig.yaml"), cv2.FILE_STORAGE_READ)
    assert (storage.getNode("cameraMatrix1").mat() == truth.left.matrix).all()
    assert (storage.getNode("distCoeffs2").mat().ravel() == truth.right.distortion).all()
    assert (storage.getNode("R").mat() == truth.rotation).all()
    assert (storage.getNode("T").mat().ravel() == truth.translation).all()
    assert storage.getNode("imageSize").at(0).real() == SIZE[0]
    assert rig_to_json(read_calibration(tmp_path / "rig.yaml").rig) == rig_to_json(truth)


@pytest.mark.parametrize(
    ("suffix", "names"),
    [
        (".yml", {}),
        (".yml", {"cameraMatrix": "K", "distCoeffs": "D"}),
        (".yml", {"cameraMatrix": "M", "distCoeffs": "D"}),
        (".yml", {"cameraMatrix": "camera_matrix_", "distCoeffs": "dist_coeffs_"}),
        (".xml", {}),
        (".json", {"cameraMatrix": "K", "distCoeffs": "D"}),
    ],
)
def test_what_opencv_writes_itself(tmp_path, suffix, names):
    truth, path = made_rig(), tmp_path / f"rig{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for index, camera in enumerate((truth.left, truth.right), start=1):
        storage.write(f"{names.get('cameraMatrix', 'cameraMatrix')}{index}", camera.matrix)
        storage.write(f"{names.get('distCoeffs', 'distCoeffs')}{index}", camera.distortion.reshape(1, 5))
    storage.write("R", truth.rotation)
    storage.write("T", truth.translation.reshape(3, 1))
    storage.release()
    close(read_calibration(path, SIZE).rig, truth)


def test_places_of_many_corners_beside_the_matrices(tmp_path):
    """Programs add what they calibrated on: here 50 photographs of 700 corners each."""
    truth, path = made_rig(), tmp_path / "rig.yml"
    write_opencv(path, truth)
    corners = np.random.default_rng(2).random((50 * 700, 2)).round(3).ravel().tolist()
    more = f"image_points: !!opencv-matrix\n   rows: 50\n   cols: 700\n   dt: '2f'\n   data: {corners}\n"
    path.write_text(path.read_text() + more)
    close(read_calibration(path).rig, truth)
    path.write_text(path.read_text().replace("data: [0", f"data: [{'1,' * 200_000} 0"))
    with pytest.raises(InputError, match=r"rig\.yml:\d+:\d+: more than 250,000 values"):
        read_calibration(path)


@pytest.mark.parametrize(("first", "second"), [("0", "1"), ("_left", "_right")])
def test_plain_lists_and_other_numberings(tmp_path, first, second):
    truth = made_rig()
    path = tmp_path / "rig.yaml"
    path.write_text(
        f"K{first}: {truth.left.matrix.tolist()}\nK{second}: {truth.right.matrix.tolist()}\n"
        f"D{first}: {[f'{value:.17g}' for value in truth.left.distortion]}\n"
        f"D{second}: {truth.right.distortion.tolist()}\n"
        f"R: {truth.rotation.tolist()}\nT: {truth.translation.tolist()}\nimage_width: 1440\nimage_height: 1080\n"
    )
    close(read_calibration(path).rig, truth)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("distCoeffs1", "dist", ("expected cameraMatrix1, distCoeffs1", "found imagesize")),
        ("2898.5512345", ".nan", ("cameramatrix1", "finite number")),
        ("   rows: 3\n   cols: 3", "   rows: 2\n   cols: 3", ("9 numbers as 2 × 3", "expected")),
        ("0.317 ]", "0.317, 1.5, 0.0, 0.0 ]", ("8 numbers as 1 × 5",)),
        ("T: !!opencv-matrix", "E: !!opencv-matrix", ("R and T", "one file")),
        ("[ 1440, 1080 ]", "[ 1440, 0 ]", ("left camera", "size of the photographs is 1440 × 0 px")),
        ("---", "---\ncamera_model: fisheye", ("cameramodel is fisheye",)),
        ("---", "---\na: &a [1]\nb: *a", (":4:4", "alias")),
        ("R: !!opencv-matrix", "R: !!python/object:os.system", ("os.system is not allowed",)),
        ("[ 0.9658", "[ 1.9658", ("R = [[1.96", "not a rotation")),
        ("T: !!opencv-matrix", "T: [0, 0, 0]\nold: !!opencv-matrix", ("expected the right camera at a distance",)),
    ],
)
def test_what_is_wrong_with_an_opencv_file(tmp_path, old, new, words):
    path = tmp_path / "rig.yaml"
    text = opencv_text(made_rig())
    assert old in text
    path.write_text(text.replace(old, new))
    refused(path, *words)


def test_terms_of_distortion_that_the_camera_has_not(tmp_path):
    path = tmp_path / "rig.yaml"
    text = opencv_text(made_rig()).replace("0.317 ]", "0.317, 0.0, 1.5, 0.0 ]").replace("cols: 5", "cols: 8", 1)
    path.write_text(text)
    refused(path, "distcoeffs1", "k5 = 1.5", "k1, k2, k3, p1, p2")
    path.write_text(text.replace("1.5", "0.0"))
    close(read_calibration(path).rig, made_rig())


def test_a_rotation_is_rounded_to_the_digits_of_its_file(tmp_path):
    truth, path = made_rig(), tmp_path / "rig.yaml"
    write_opencv(path, truth._replace(rotation=truth.rotation.round(6)))
    rotation = read_calibration(path).rig.rotation
    np.testing.assert_allclose(rotation, truth.rotation, atol=1e-6)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    write_opencv(path, truth._replace(rotation=truth.rotation @ np.diag([1.0, 1, -1])))
    refused(path, "mirrors")


def test_a_baseline_in_metres_is_pointed_out(tmp_path):
    truth = made_rig()
    write_opencv(tmp_path / "rig.yaml", truth._replace(translation=truth.translation / 1000))
    assert "metres" in read_calibration(tmp_path / "rig.yaml").warnings[0]


def test_the_law_of_vic3d_is_pointed_out(tmp_path):
    truth, path = made_rig(tangential=False), tmp_path / "v.xml"
    FILES["vic3d.xml"](path, truth)
    corner = truth.left.matrix[:2, 2] / truth.left.matrix[[0, 1], [0, 1]]
    shift = project(truth.left, [-corner[0], -corner[1], 1.0])
    (warning,) = read_calibration(path, SIZE).warnings
    assert f"corner by {np.hypot(*shift):.2g} px" in warning
    straight = [camera._replace(distortion=np.zeros(5)) for camera in (truth.left, truth.right)]
    FILES["vic3d.xml"](path, truth._replace(left=straight[0], right=straight[1]))
    assert not read_calibration(path, SIZE).warnings


def test_a_project_of_vic3d_names_cameras_elsewhere_too(tmp_path):
    path, truth = tmp_path / "v.xml", made_rig(tangential=False)
    path.write_text(vic3d_xml(truth).replace("</project>", '<view><camera id="0">front</camera></view></project>'))
    close(read_calibration(path, SIZE).rig, truth)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('<camera id="1">', '<camera id="2">', ("cameras 0 and 1", "found 0, 2")),
        ("<orientation>", "<orientation>x", ("camera 0", "orientation is 'x")),
        ("701.32 ", "", ("camera 0", "has 7 numbers, expected 8")),
        ("</camera>", "", ("damaged XML", "line")),
        ("701.32 ", "701,32 ", ("camera 0", "has 9 numbers, expected 8", "decimal points")),
        ("<!DOCTYPE vpml>", '<!DOCTYPE vpml [<!ENTITY a "b">]>', (":2", "XML entity")),
        ("<!DOCTYPE vpml>", '<!DOCTYPE vpml [<!ENTITY a SYSTEM "file:///etc/passwd">]>', (":2", "XML entity")),
    ],
)
def test_what_is_wrong_with_a_vic3d_file(tmp_path, old, new, words):
    path, text = tmp_path / "v.xml", vic3d_xml(made_rig(tangential=False))
    assert old in text
    path.write_text(text.replace(old, new))
    refused(path, *words)


def test_archives_that_are_no_project(tmp_path):
    path = tmp_path / "v.z3d"
    path.write_bytes(zipped({"../project.xml": b"<project/>"}))
    refused(path, "holds no project.xml")
    whole = zipped({"project.xml": vic3d_xml(made_rig(tangential=False)).encode()})
    path.write_bytes(whole[:200])
    refused(path, "archive is damaged")
    path.write_bytes(zipped({"project.xml": b" " * 50_000_001}))
    assert path.stat().st_size < 100_000
    refused(path, "unpacks to more than 5,000,000 bytes")
    encrypted = bytearray(whole)
    encrypted[6] |= 1
    encrypted[whole.rindex(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(encrypted)
    refused(path, "archive is damaged", "encrypted")


def test_the_models_of_dice(tmp_path):
    truth, path = made_rig(tangential=False), tmp_path / "d.xml"
    for model in ("OPENCV_LENS_DISTORTION", "K1R3_K2R5_K3R7", "VIC3D_DIS"):
        dice(path, truth, model=model)
        found = read_calibration(path)
        close(found.rig, truth)
        assert bool(found.warnings) == (model == "VIC3D_DIS")
    for model in ("K1R1_K2R2_K3R3", "K1R2_K2R4_K3R6", "SOMETHING"):
        dice(path, truth, model=model)
        refused(path, "CAMERA 0", model, "OPENCV_DIS")
    dice(path, truth, model="NONE")
    refused(path, "CAMERA 0: has K1 = -0.112", "the model NONE")
    dice(path, truth._replace(left=truth.left._replace(distortion=np.zeros(5))), model="NONE")
    refused(path, "CAMERA 1: has K1")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('value="OPENCV"', 'value="OTHER"', ("system_type_3D is 'OTHER'", "GENERIC_SYSTEM")),
        ('name="K1"', 'name="K5"', ("CAMERA 0", "K5 = -0.112")),
        ('name="K1"', 'name="FS"', ("CAMERA 0", "FS = -0.112")),
        ('name="FX"', 'name="F"', ("CAMERA 0", "FX missing")),
        ("CAMERA 1", "CAMERA 2", ("CAMERA 1 is missing",)),
        ("{ 1080, 1440 }", "{ 1080 }", ("IMAGE_HEIGHT_WIDTH has 1 numbers",)),
        ('"BETA" type="double" value="', '"BETA" type="double" value="x', ("BETA is 'x",)),
    ],
)
def test_what_is_wrong_with_a_dice_file(tmp_path, old, new, words):
    path = tmp_path / "d.xml"
    dice(path, made_rig())
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    refused(path, *words)


def test_poses_of_dice_that_contradict_each_other(tmp_path):
    path = tmp_path / "d.xml"
    dice(path, made_rig(), world=True)
    said = '"extrinsics_relative_camera_to_camera" type="bool" value="false"'
    assert said in path.read_text()
    text = path.read_text()
    path.write_text(text.replace(said, said.replace("false", "true")))
    refused(path, "CAMERA 1", "relative to CAMERA 0")
    path.write_text(text.replace("extrinsics_relative_camera_to_camera", "note"))
    refused(path, "true or false")
    dice(path, made_rig(), matrix=True)
    angle = '<Parameter name="BETA" type="double" value="3.0"/><Parameter name="CX"'
    path.write_text(path.read_text().replace('<Parameter name="CX"', angle))
    refused(path, "CAMERA 0", "different rotations")


def test_what_is_wrong_with_a_matlab_file(tmp_path):
    path, truth = tmp_path / "m.mat", made_rig()
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")
    refused(path, "7.3", "save('calibration.mat', '-struct', 's', '-v7')")
    path.write_bytes(b"MATLAB 5.0 MAT-file, Platform: GLNXA64")
    refused(path, "damaged", "in MATLAB run")
    savemat(path, {"stereoParams": np.zeros(3)})
    refused(path, "no structure with CameraParameters1, CameraParameters2", "RotationOfCamera2")
    savemat(path, {"CameraParameters1": {"K": np.array([["a", 2.0]], dtype=object)}, "CameraParameters2": {}})
    refused(path, "CameraParameters1: K is not a plain array")
    savemat(path, {"CameraParameters1": 1.0, "CameraParameters2": 2.0})
    refused(path, "CameraParameters1: is an object", "in MATLAB run")
    matlab(path, truth, RotationOfCamera2=np.eye(2))
    refused(path, "RotationOfCamera2 is 2 × 2, expected 3 × 3")
    matlab(path, truth, TranslationOfCamera2=np.array(["a", "b"]))
    refused(path, "TranslationOfCamera2 is not a plain array")


def test_a_matlab_structure_inside_a_variable_and_in_metres(tmp_path):
    path, truth = tmp_path / "m.mat", made_rig()
    matlab(path, truth)
    from scipy.io import loadmat

    inner = {name: value for name, value in loadmat(path, simplify_cells=True).items() if not name.startswith("__")}
    inner["CameraParameters1"]["WorldUnits"] = "meters"
    inner["TranslationOfCamera2"] = truth.translation / 1000.0
    savemat(path, {"s": inner})
    close(read_calibration(path).rig, truth)
    inner["CameraParameters1"]["WorldUnits"] = "furlongs"
    savemat(path, {"s": inner})
    refused(path, "WorldUnits is 'furlongs'")


def test_a_matlab_file_that_does_not_say_its_unit(tmp_path):
    path, truth = tmp_path / "m.mat", made_rig()
    matlab(path, truth)
    found = read_calibration(path)
    close(found.rig, truth)
    assert any("no WorldUnits" in warning for warning in found.warnings)


def test_matlab_is_told_to_save_the_unit(tmp_path):
    path = tmp_path / "m.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")
    refused(path, "'WorldUnits', p.WorldUnits")


def test_a_matrix_that_is_transposed(tmp_path):
    path, truth = tmp_path / "m.mat", made_rig()
    matlab(path, truth)
    matlab(path, truth, CameraParameters1={"K": truth.left.matrix.T, "RadialDistortion": np.zeros(2)})
    refused(path, "left camera", "transpose it")


@pytest.mark.parametrize("content", [b"", b"\x00\xff\x00", b"x,y\n1,2\n", b"a: 1\n", b"<html/>", b"{}"])
def test_files_that_are_no_calibration(tmp_path, content):
    path = tmp_path / "none.yaml"
    path.write_bytes(content)
    refused(path, "not a calibration of two cameras", "MatchID", "OpenCV YAML with cameraMatrix1")


def test_files_that_cannot_be_read(tmp_path):
    refused(tmp_path / "none.yaml", "cannot be read (no such file")
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(50_000_001)
    refused(tmp_path / "huge", "50,000,001 bytes")


@pytest.mark.parametrize("name", FILES)
def test_damaged_files_give_a_message_or_a_rig(tmp_path, name):
    FILES[name](tmp_path / name, made_rig(tangential=False))
    whole, generator = (tmp_path / name).read_bytes(), np.random.default_rng(11)
    refusals = 0
    for trial in range(60):
        data = bytearray(whole)
        start, end = np.sort(generator.integers(0, len(data), 2))
        if trial % 3 == 0:
            data[start] = generator.integers(256)
        elif trial % 3 == 1:
            data = data[:end]
        else:
            data[start:start] = data[end : end + 50]
        (tmp_path / name).write_bytes(data)
        try:
            read_calibration(tmp_path / name, SIZE)
        except InputError:
            refusals += 1
    assert refusals > 20


# real files


def displacements(rig: Rig, table: np.ndarray) -> np.ndarray:
    """Displacement (n, 3) [mm] of points seen before and after by both cameras."""
    return meet(rig, table[:, 4:6], table[:, 6:8]) - meet(rig, table[:, 0:2], table[:, 2:4])


def meet(rig: Rig, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Points (n, 3) where rays meet, by OpenCV."""
    seen = [undistort(camera, points).T for camera, points in ((rig.left, left), (rig.right, right))]
    found = cv2.triangulatePoints(np.eye(3, 4), np.column_stack([rig.rotation, rig.translation]), *map(np.copy, seen))
    return (found[:3] / found[3]).T


@pytest.fixture(scope="module")
def specimen(shared_data):
    """Folder of the steel part, points (n, 8) of another program in all four photographs, and their displacement."""
    folder = shared_data / "d_specimen"
    given = np.genfromtxt(folder / "reference" / "points_0273.csv", delimiter=",", names=True, deletechars="")
    columns = ("x", "y", "r2_x", "r2_y", "t1_x", "t1_y", "t2_x", "t2_y")
    table, motion = (np.column_stack([given[name] for name in names]) for names in (columns, "uvw"))
    return folder, table, motion


def test_two_calibrations_of_one_real_rig(specimen):
    """They agree on the displacement to 0.04 %; their frames are turned against each other."""
    folder, table, _ = specimen
    vic3d = read_calibration(folder / "calibration_vic3d.xml", (1920, 1200))
    other = read_calibration(folder / "calibration_dice.xml", (1920, 1200))
    assert "not published" in vic3d.warnings[0]
    lengths = [np.linalg.norm(displacements(one.rig, table), axis=1).mean() for one in (vic3d, other)]
    np.testing.assert_allclose(lengths[0], lengths[1], rtol=4e-4)


def test_the_rig_of_published_points_gives_their_displacement(specimen):
    folder, table, motion = specimen
    rig = read_calibration(folder / "reference" / "points_0273_rig.yaml", (1920, 1200)).rig
    np.testing.assert_allclose(displacements(rig, table).mean(axis=0), motion.mean(axis=0), atol=5e-5)


def test_the_boards_truth_is_the_reference_rig(shared_data):
    folder = shared_data / "d_specimen" / "reference"
    truth = read_calibration(folder / "boards_truth.xml").rig
    rig = read_calibration(folder / "points_0273_rig.yaml", truth.left.size).rig
    assert rotation_angle_deg(truth.rotation, rig.rotation) < 1e-5
    np.testing.assert_allclose(truth.translation, rig.translation, atol=1e-4)


def test_the_matlab_calibration_of_real_points(shared_data, tmp_path):
    """Points that the program itself triangulated, with pixels counted from 1."""
    given = np.load(shared_data / "rigid_points" / "stereo_calibration.npz")
    points = np.load(shared_data / "rigid_points" / "RBM_matched_points.npz")
    cameras = {
        f"CameraParameters{k}": {
            "IntrinsicMatrix": given[f"K{k}"].T,
            "RadialDistortion": given[f"d{k}"][:2],
            "TangentialDistortion": given[f"d{k}"][2:],
            "ImageSize": given["image_size"][::-1],
        }
        for k in (1, 2)
    }
    savemat(tmp_path / "m.mat", {**cameras, "RotationOfCamera2": given["R"].T, "TranslationOfCamera2": given["t"]})
    rig = read_calibration(tmp_path / "m.mat", (2448, 2048)).rig
    truth = points["X3d_triangulated"][0, ::100]
    left, right = (points[f"points_cam{k}"][0, ::100] - 1.0 for k in (1, 2))
    here = meet(rig, left, right)
    np.testing.assert_allclose(here, truth, atol=1e-9)
    assert np.abs(project(rig.right, to_right(rig, here)) - right).mean() < 0.05


@pytest.mark.parametrize("name", FILES)
def test_one_specific_format_recognises_each_file(tmp_path, name):
    FILES[name](tmp_path / name, made_rig(tangential=False))
    source = Source(tmp_path / name, (tmp_path / name).read_bytes())
    formats = {known: FORMATS.load(known) for known in FORMATS.names()}
    fitting = {known for known, module in formats.items() if module.recognises(source)}
    general = {known for known, module in formats.items() if getattr(module, "GENERAL", False)}
    assert general == {"opencv"}
    assert len(fitting - general) == 1 or fitting == general


def test_the_modules_of_all_formats_are_listed_without_numerics():
    code = (
        "import sys; from dicflow.stages.rig_file import RigFile; print(*RigFile(file='x').uses())\n"
        "assert 'numpy' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert tuple(done.stdout.split()) == calibration_modules()
    names = ["dice", "dicflow_json", "matchid", "matlab", "opencorr", "opencv", "pyvale", "vic3d"]
    assert set(calibration_modules()) == {f"dicflow.io.calibrations.{name}" for name in names}


@pytest.mark.parametrize("name", ["pyvale.csv", "opencorr.csv", "matchid.caldat"])
@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas_are_read(tmp_path, name, separator):
    truth, path = made_rig(), tmp_path / name
    FILES[name](path, truth)
    text = path.read_text(encoding="utf-8").replace(",", separator).replace(";", separator).replace(".", ",")
    path.write_bytes(text.replace("\n", "\r\n").encode("utf-16"))
    close(read_calibration(path, SIZE).rig, truth)


@pytest.mark.parametrize("name", ["pyvale.csv", "opencorr.csv"])
def test_decimal_commas_between_commas_are_refused(tmp_path, name):
    path = tmp_path / name
    FILES[name](path, made_rig())
    path.write_text(path.read_text().replace(".", ","))
    refused(path, "value(s)", "decimal points")
    FILES[name](path, made_rig())
    path.write_text(path.read_text().replace("\n", ",a note\n"))
    close(read_calibration(path, SIZE).rig, made_rig())


def test_a_decimal_comma_before_a_negative_number_is_refused(tmp_path):
    path = tmp_path / "opencorr.csv"
    FILES["opencorr.csv"](path, made_rig())
    path.write_text(re.sub(r"(?m)^Ty,.*$", "Ty,0,5,-3", path.read_text()))
    refused(path, "Ty", "value(s)", "decimal points")


@pytest.mark.parametrize("again", ["T: [1, 2, 3]", "t: [1, 2, 3]"])
def test_an_entry_that_stands_twice_in_opencv_is_refused(tmp_path, again):
    path = tmp_path / "rig.yaml"
    path.write_text(opencv_text(made_rig()) + again + "\n")
    refused(path, "two entries of one name", "leave one of them")


def test_numbers_that_may_have_a_separator_of_thousands_are_refused(tmp_path):
    path = tmp_path / "m.caldat"
    matchid(path, made_rig())
    path.write_text(re.sub(r";[-\d.e]+", ";1,234", path.read_text()))
    refused(path, ":1", "'1,234' may be 1.234 or 1234")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("2898.5512345", "1e308", ("1e308", "finite number")),
        ("2898.5512345", "0.5", ("left camera", "focal lengths", "10,000,000")),
        ("0.317 ]", "1e8 ]", ("left camera", "corner out of all bounds")),
        ("-180.6123456", "-1e7", ("T = ", "1,000,000 mm")),
        ("[ 1440, 1080 ]", "[ 144000, 1080 ]", ("144000", "100,000")),
        ("T: !!opencv", "r: !!opencv-matrix {}\nT: !!opencv", ("two entries",)),
    ],
)
def test_numbers_that_no_camera_has_are_refused(tmp_path, old, new, words):
    path, text = tmp_path / "rig.yaml", opencv_text(made_rig())
    assert old in text
    path.write_text(text.replace(old, new))
    refused(path, *words, size=None)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"\n" * 1_000_000 + b"cam0", ("not a calibration",)),
        (b"fx" + b" " * 1_000_000, ("not a calibration",)),
        (b"Cam0_Fx;1\na" + b" " * 100_000 + b"x;", ("tx, ty, tz",)),
        (b"cam0_fx" + b" a" * 1_000_000, (":1", "expected a name and a number")),
        (b"a: " + b" " * 1_000_000 + b":", ("not a calibration",)),
        (b"%YAML:1.0\nK1: [" + b"1.5, " * 500_000 + b"]", ("more than 250,000 values",)),
        (b"%YAML:1.0\na: " + b"x" * 6_000_000, ("larger (6,000,",)),
        (b"<project><camera/><orientation/>" + b"<b/>" * 200_000 + b"</project>", ("100,000 elements",)),
        (b"<project><camera/><orientation/>" + b"<b>" * 5_000, ("inside each other",)),
        (
            b'<!DOCTYPE a [<!ATTLIST b c CDATA "' + b"x" * 100_000 + b'">]><a><camera/><orientation/></a>',
            ("declarations",),
        ),
    ],
    ids=range(10),
)
def test_small_files_that_would_take_long_are_refused(tmp_path, data, words):
    """Each took from seconds to hours, or gigabytes; the tests of ``tests/fuzz`` hold readers to their limits."""
    (tmp_path / "c").write_bytes(data)
    refused(tmp_path / "c", *words)


@pytest.mark.parametrize("way", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_archives_that_vic3d_does_not_write(tmp_path, way):
    with zipfile.ZipFile(tmp_path / "v.z3d", "w", way) as archive:
        archive.writestr("project.xml", vic3d_xml(made_rig(tangential=False)))
    refused(tmp_path / "v.z3d", "packed in another way")


def test_archives_of_very_many_files(tmp_path):
    with zipfile.ZipFile(tmp_path / "v.z3d", "w") as archive:
        archive.writestr("project.xml", b"<a/>")
    (tmp_path / "v.z3d").write_bytes((tmp_path / "v.z3d").read_bytes() + b"PK\x01\x02" * 50_001)
    refused(tmp_path / "v.z3d", "more than 50,000 files")
