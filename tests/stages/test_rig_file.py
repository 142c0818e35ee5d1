"""The rig from a file: the stage alone, and a pipeline that says ``rig: {stage: rig_file, file: …}``."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from small import dicflow

from dicflow.core.cameras.camera import Camera, Rig, rotation_matrix
from dicflow.engine.product import Product
from dicflow.errors import InputError
from dicflow.io.calibrations.opencv import write_opencv
from dicflow.io.calibrations.read import read_calibration
from dicflow.io.exports.items import Item
from dicflow.io.exports.json import write
from dicflow.io.rig import read_rig
from dicflow.kinds.images import Images
from dicflow.kinds.rig import CalibratedRig, rig_from_json, rig_to_json
from dicflow.pipeline import Pipeline
from dicflow.stages.rig_file import RigFile

pytestmark = pytest.mark.slow

SIZE = (160, 120)
PIPELINE = """\
stages:
  photos: {stage: images, left: "left*.png", right: "right*.png"}
  rig: {stage: rig_file, file: CALIBRATION}
  pair: {stage: rectify, images: photos}
"""


def made_rig() -> Rig:
    matrix = np.array([[400.5, 0, 81.25], [0, 401.25, 58.5], [0, 0, 1]])
    left = Camera(matrix, np.array([-0.1, 0.02, 1e-4, -2e-4, 0.0]), SIZE)
    return Rig(
        left, left._replace(matrix=matrix + 1.5 * np.eye(3, k=2)), rotation_matrix([0, 0.2, 0]), np.array([-80.0, 0, 8])
    )


MATCHID = (
    "".join(
        f"Cam{index}_Fx [pixels];400.5\nCam{index}_Fy [pixels];401.25\n"
        f"Cam{index}_Cx [pixels];{cx}\nCam{index}_Cy [pixels];58.5\n"
        f"Cam{index}_Kappa 1;-0.1\nCam{index}_Kappa 2;0.02\nCam{index}_P1;0.0001\nCam{index}_P2;-0.0002\n"
        for index, cx in ((0, 81.25), (1, 82.75))
    )
    + f"Tx [mm];-80\nTy [mm];0\nTz [mm];8\nTheta [deg];0\nPhi [deg];{np.degrees(0.2)!s}\nPsi [deg];0\n"
)


def photographs(width: int = SIZE[0], height: int = SIZE[1]) -> Product:
    image = np.zeros((height, width), np.uint8)
    return Images.write(image, image)


@pytest.fixture
def folder(tmp_path):
    """Photographs of two steps, and the calibration in two formats."""
    generator = np.random.default_rng(1)
    for step in (0, 1):
        for side in ("left", "right"):
            grey = generator.integers(0, 255, SIZE[::-1], dtype=np.uint8)
            Image.fromarray(grey).save(tmp_path / f"{side}{step}.png")
    (tmp_path / "cal.caldat").write_text(MATCHID)
    write_opencv(tmp_path / "cal.yaml", made_rig())
    return tmp_path


def pipeline(folder, calibration: str):
    path = folder / "pipeline.yaml"
    path.write_text(PIPELINE.replace("CALIBRATION", calibration))
    return path


def run(folder, calibration: str):
    arguments = ("--scheduler", "sync", "--workers", 1, "--json", "--output", folder / "o")
    return dicflow("run", pipeline(folder, calibration), *arguments)


def test_how_exact_a_rig_is_goes_with_its_file(folder):
    root = np.random.default_rng(2).normal(size=(24, 24))
    exported = CalibratedRig.write(made_rig(), "", {}, covariance=root @ root.T)
    write([Item("rig", None, exported)], folder, "test")
    product = RigFile(file="rig.json").run(file_path=folder / "rig.json", images=photographs())
    assert product.attrs["covariance"] == exported.attrs["covariance"]
    assert "covariance" not in RigFile(file="cal.yaml").run(folder / "cal.yaml", photographs()).attrs


def test_the_rig_that_the_file_holds(folder):
    node = RigFile(file="cal.yaml")
    product = node.run(file_path=folder / "cal.yaml", images=photographs())
    assert rig_to_json(rig_from_json(product.attrs["rig"])) == rig_to_json(made_rig())
    assert product.attrs["warnings"] == []
    assert product.attrs["summary"]["baseline_mm"] == pytest.approx(np.hypot(80.0, 8.0))
    assert product.attrs["summary"]["angle_deg"] == pytest.approx(np.degrees(0.2))
    assert "cal.yaml of OpenCV (YAML, XML): 160 × 120 px, cameras 80.4 mm and 11.5° apart" in product.attrs["verdict"]
    assert "covariance" not in product.attrs


def test_the_photographs_say_their_size_where_the_file_does_not(folder):
    path = folder / "cal.caldat"
    node = RigFile(file=str(path))
    facts = {path: node.check(path)}
    node.agree(facts, {}, {"images": ("0", "1")})
    with pytest.raises(InputError, match=r"cal\.caldat: does not give the size .* as 'images'"):
        node.agree(facts, {}, {})
    rig = rig_from_json(node.run(file_path=path, images=photographs()).attrs["rig"])
    assert rig.left.size == rig.right.size == SIZE
    np.testing.assert_allclose(rig.rotation, made_rig().rotation, atol=1e-12)


def test_a_file_that_says_it_needs_no_photographs(folder):
    path = folder / "cal.yaml"
    node = RigFile(file=str(path))
    node.agree({path: node.check(path)}, {}, {})
    assert node.run(file_path=path).attrs["rig"]["left"]["size"] == list(SIZE)


def test_photographs_of_another_size(folder):
    node, path = RigFile(file="cal.yaml"), folder / "cal.yaml"
    with pytest.raises(InputError, match=r"160 × 120 .* 0\.5 .* 80 × 60"):
        node.run(file_path=path, images=photographs(80, 60))
    with pytest.raises(InputError, match=r"160 × 120 .* 160 × 100"):
        node.run(file_path=path, images=photographs(160, 100))


def test_an_offset_of_windows_that_are_smaller(folder):
    """Of a file with sizes and of one without: the window is as large as the photographs."""
    for name in ("cal.yaml", "cal.caldat"):
        node = RigFile(file=str(folder / name), offset={"left": [30, 20], "right": [10, 0]})
        rig = rig_from_json(node.run(folder / name, photographs(80, 60)).attrs["rig"])
        assert rig.left.size == rig.right.size == (80, 60)
        np.testing.assert_allclose(rig.left.matrix[:2, 2], [51.25, 38.5])
        np.testing.assert_allclose(rig.right.matrix[:2, 2], [72.75, 58.5])


def test_two_cameras_of_different_size(folder):
    rig = made_rig()
    write_opencv(folder / "cal.yaml", rig._replace(right=rig.right._replace(size=(140, 110))))
    pair = Images.write(np.zeros(SIZE[::-1], np.uint8), np.zeros((110, 140), np.uint8))
    found = rig_from_json(RigFile(file="cal.yaml").run(folder / "cal.yaml", pair).attrs["rig"])
    assert (found.left.size, found.right.size) == (SIZE, (140, 110))
    with pytest.raises(InputError, match=r"right camera: was calibrated on .* 140 × 110 px"):
        RigFile(file="cal.yaml").run(folder / "cal.yaml", photographs())


def test_warnings_are_in_the_verdict(folder):
    write_opencv(folder / "cal.yaml", made_rig()._replace(translation=np.array([-0.08, 0, 0.008])))
    product = RigFile(file="cal.yaml").run(file_path=folder / "cal.yaml")
    assert len(product.attrs["warnings"]) == 1
    assert product.attrs["verdict"].endswith(f"; note that {product.attrs['warnings'][0]}")


# in a pipeline


def rectified(folder) -> np.ndarray:
    return Pipeline.load(folder / "pipeline.yaml").result().product("pair", "left1")["right"]


def test_a_pipeline_with_a_rig_from_a_file(folder):
    """Two formats of one rig give the same rectified photographs; what is exported reads back."""
    answer = run(folder, "cal.caldat")
    assert answer.code == 0, answer.err
    assert answer.line["counts"]["computed"] == 5
    assert "rig: read from cal.caldat of MatchID: 160 × 120 px" in answer.err
    first = rectified(folder)
    assert run(folder, "cal.yaml").line["stages"]["photos"]["hit"] == 2
    assert np.mean(rectified(folder) != first) < 1e-3  # grey levels that a rounding of the last digit turns over
    for name, file in (("opencv", "rig.yaml"), ("json", "rig.json")):
        answer = dicflow("export", folder / "pipeline.yaml", "rig", "--format", name, "--output", folder)
        assert answer.code == 0, answer.err
        assert rig_to_json(read_calibration(folder / file).rig) == rig_to_json(made_rig())
    assert rig_to_json(read_rig(folder / "rig.json")) == rig_to_json(made_rig())
    assert run(folder, "rig.json").code == 0
    exported = ("export", folder / "pipeline.yaml", "pair", "--format", "opencv", "--output", folder)
    dicflow(*exported).refuses(2, "pair: ", "rectified", "opencv")


def test_a_bad_calibration_stops_before_anything_runs(folder):
    (folder / "cal.caldat").write_text(MATCHID.replace("Tx [mm];-80", "Tx [mm];x"))
    run(folder, "cal.caldat").refuses(2, "cal.caldat:17: 'Tx [mm];x'")
    run(folder, "left0.png").refuses(2, "left0.png: ", "calibration")
    run(folder, "none.xml").refuses(2, "none.xml", "no such file")
    assert not (folder / ".dicflow" / "objects").exists()


def test_photographs_of_another_size_in_a_pipeline(folder):
    write_opencv(folder / "cal.yaml", read_calibration(folder / "cal.caldat", (320, 240)).rig)
    run(folder, "cal.yaml").refuses(1, "rig: ", "cal.yaml", "320 × 240 px", " 0.5 ")
