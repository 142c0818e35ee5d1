"""One rig in the files of every program, as the tests write them."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.io import savemat

from dicflow.core.cameras.camera import Camera, Rig, rotation_matrix, rotation_vector
from dicflow.io.calibrations.draft import euler_deg
from dicflow.io.calibrations.opencv import write_opencv
from dicflow.io.rig import write_rig

SIZE = (1440, 1080)
WORLD = euler_deg(178.7, 7.3, -1.9), np.array([-58.2, 3.1, 410.6])
"""Pose of the left camera in a world that is not its own frame."""


def made_rig(tangential: bool = True) -> Rig:
    """Two cameras that differ in every number."""
    p = np.array([3e-4, -2e-4, -1e-4, 4e-4]) * tangential
    left = Camera(
        np.array([[2898.5512345, 0, 701.32], [0, 2897.9076543, 552.81], [0, 0, 1]]),
        np.array([-0.1123456789, 0.2234, p[0], p[1], 0.317]),
        SIZE,
    )
    right = Camera(
        np.array([[2911.204, 0, 733.9], [0, 2910.66, 531.4], [0, 0, 1]]),
        np.array([-0.0987654321, 0.1812, p[2], p[3], -0.25]),
        SIZE,
    )
    return Rig(left, right, rotation_matrix([0.011, 0.262, -0.0071]), np.array([-180.6123456, 1.2345, 24.3219]))


def angles_deg(rotation: np.ndarray) -> tuple[float, float, float]:
    """x, y, z of R = Rz(z) · Ry(y) · Rx(x)."""
    return (
        float(np.degrees(np.arctan2(rotation[2, 1], rotation[2, 2]))),
        float(np.degrees(-np.arcsin(rotation[2, 0]))),
        float(np.degrees(np.arctan2(rotation[1, 0], rotation[0, 0]))),
    )


def in_world(rig: Rig) -> list[tuple[np.ndarray, np.ndarray]]:
    """Poses of both cameras in the world."""
    rotation, translation = WORLD
    return [WORLD, (rig.rotation @ rotation, rig.rotation @ translation + rig.translation)]


def values(camera: Camera) -> dict[str, float]:
    """Parameters by their usual names."""
    matrix, names = camera.matrix, ("k1", "k2", "p1", "p2", "k3")
    intrinsics = {"fx": matrix[0, 0], "fy": matrix[1, 1], "fs": matrix[0, 1], "cx": matrix[0, 2], "cy": matrix[1, 2]}
    found = {**intrinsics, **dict(zip(names, camera.distortion, strict=True))}
    return {name: float(value) for name, value in found.items()}


def matchid(path: Path, rig: Rig, line: str = "{name} {unit};{value!r}") -> None:
    rows = []
    for index, camera in enumerate((rig.left, rig.right)):
        found = values(camera)
        rows += [(f"Cam{index}_{name.capitalize()}", "[pixels]", found[name]) for name in ("fx", "fy", "fs")]
        rows += [(f"Cam{index}_Kappa {order}", "", found[f"k{order}"]) for order in (1, 2, 3)]
        rows += [(f"Cam{index}_{name.capitalize()}", "", found[name]) for name in ("p1", "p2")]
        rows += [(f"Cam{index}_{name.capitalize()}", "[pixels]", found[name]) for name in ("cx", "cy")]
    rows += [(name, "[mm]", float(v)) for name, v in zip(("Tx", "Ty", "Tz"), rig.translation, strict=True)]
    rows += [(n, "[deg]", v) for n, v in zip(("Theta", "Phi", "Psi"), angles_deg(rig.rotation), strict=True)]
    text = "".join(line.format(name=name, unit=unit, value=value) + "\n" for name, unit, value in rows)
    path.write_text(text, encoding="utf-8")


def pyvale(path: Path, rig: Rig) -> None:
    rows = []
    for index, camera in enumerate((rig.left, rig.right)):
        found = values(camera)
        rows += [(f"cam{index}_{name}_px", found[name]) for name in ("fx", "fy", "fs", "cx", "cy")]
        rows += [(f"cam{index}_{name}", found[name]) for name in ("k1", "k2", "p1", "p2", "k3")]
    rows += [(f"t{axis}_mm", float(v)) for axis, v in zip("xyz", rig.translation, strict=True)]
    rows += [(f"{n}_deg", v) for n, v in zip(("theta", "phi", "psi"), angles_deg(rig.rotation), strict=True)]
    path.write_text("".join(f"{name},{value!r}\n" for name, value in rows))


def opencorr(path: Path, rig: Rig, degrees: bool = False) -> None:
    turn = angles_deg(rig.rotation) if degrees else rotation_vector(rig.rotation)
    left, right = ({**values(camera), "k4": 0.0, "k5": 0.0, "k6": 0.0} for camera in (rig.left, rig.right))
    for axis, shift, angle in zip("xyz", rig.translation, turn, strict=True):
        left |= {f"t{axis}": 0.0, f"r{axis}": 0.0}
        right |= {f"t{axis}": float(shift), f"r{axis}": float(angle)}
    rows = [f"{name.capitalize()},{left[name]!r},{right[name]!r}\n" for name in left]
    path.write_text("parameter,left camera,right camera\n" + "".join(rows))


def vic3d_xml(rig: Rig, newer: bool = False) -> str:
    lines = ['<?xml version="1.0" encoding="ISO-8859-1"?>', "<!DOCTYPE vpml>", "<project>", '<calibration lri="c">']
    for index, (camera, (rotation, place)) in enumerate(zip((rig.left, rig.right), in_world(rig), strict=True)):
        found = values(camera)
        intrinsics = " ".join(repr(found[name]) for name in ("cx", "cy", "fx", "fy", "fs"))
        terms = " ".join(repr(found[name]) for name in ("k1", "k2", "k3"))
        pose = " ".join(repr(float(v)) for v in (*angles_deg(rotation), *place))
        body = f"{intrinsics} {terms}"
        if newer:
            body = f"<intrinsics>{intrinsics}</intrinsics><distortion>{terms}</distortion>"
        lines.append(f'<camera id="{index}">{body}<orientation>{pose}</orientation></camera>')
    return "\n".join([*lines, "</calibration>", "</project>"])


def vic3d(path: Path, rig: Rig) -> None:
    path.write_text(vic3d_xml(rig), encoding="latin-1")


def z3d(path: Path, rig: Rig) -> None:
    path.write_bytes(zipped({"project.xml": vic3d_xml(rig, newer=True).encode("latin-1"), "data/a.out": b"0"}))


def zipped(members: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return buffer.getvalue()


def dice(path: Path, rig: Rig, *, matrix: bool = False, world: bool = False, model: str = "OPENCV_DIS") -> None:
    def entry(name: str, value: object, kind: str = "double") -> str:
        return f'<Parameter name="{name}" type="{kind}" value="{value}"/>'

    poses = in_world(rig) if world else [(np.eye(3), np.zeros(3)), (rig.rotation, rig.translation)]
    lines = ["<ParameterList>", entry("xml_file_format", "DICe_xml_camera_system_file", "string")]
    lines += [entry("system_type_3D", "OPENCV", "string")]
    lines += [entry("extrinsics_relative_camera_to_camera", str(not world).lower(), "bool")]
    for index, (camera, (rotation, place)) in enumerate(zip((rig.left, rig.right), poses, strict=True)):
        found = {name.upper(): value for name, value in values(camera).items() if value}
        found |= {name: float(v) for name, v in zip(("TX", "TY", "TZ"), place, strict=True)}
        lines.append(f'<ParameterList name="CAMERA {index}">')
        if matrix:
            rows = [
                entry(f"ROW {k}", "{ " + ", ".join(map(repr, rotation[k].tolist())) + " }", "string") for k in range(3)
            ]
            lines += ['<ParameterList name="rotation_3x3_matrix">', *rows, "</ParameterList>"]
        else:
            found |= dict(zip(("ALPHA", "BETA", "GAMMA"), angles_deg(rotation), strict=True))
        lines += [entry(name, repr(value)) for name, value in found.items()]
        lines += [entry("LENS_DISTORTION_MODEL", model, "string")]
        width, height = camera.size
        lines += [entry("IMAGE_HEIGHT_WIDTH", f"{{ {height}, {width} }}", "string"), "</ParameterList>"]
    path.write_text("\n".join([*lines, "</ParameterList>"]))


def matlab(path: Path, rig: Rig, newer: bool = False, **more: object) -> None:
    contents: dict[str, object] = {}
    for index, camera in enumerate((rig.left, rig.right), start=1):
        matrix = camera.matrix + np.array([[0.0, 0, 1], [0, 0, 1], [0, 0, 0]])
        k1, k2, p1, p2, k3 = camera.distortion
        contents[f"CameraParameters{index}"] = {
            **({"K": matrix} if newer else {"IntrinsicMatrix": matrix.T}),
            "RadialDistortion": np.array([k1, k2, k3]),
            "TangentialDistortion": np.array([p1, p2]),
            "ImageSize": np.array(camera.size[::-1], dtype=float),
        }
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rig.rotation, rig.translation
    older = {"RotationOfCamera2": rig.rotation.T, "TranslationOfCamera2": rig.translation}
    savemat(path, {**contents, **({"PoseCamera2": {"A": pose}} if newer else older), **more})


FILES: dict[str, Callable[[Path, Rig], None]] = {
    "opencv.yaml": write_opencv,
    "dicflow.json": write_rig,
    "matchid.caldat": matchid,
    "pyvale.csv": pyvale,
    "opencorr.csv": opencorr,
    "opencorr_degrees.csv": lambda path, rig: opencorr(path, rig, degrees=True),
    "vic3d.xml": vic3d,
    "vic3d.z3d": z3d,
    "dice.xml": dice,
    "dice_matrix.xml": lambda path, rig: dice(path, rig, matrix=True),
    "dice_world.xml": lambda path, rig: dice(path, rig, world=True),
    "matlab.mat": matlab,
    "matlab_newer.mat": lambda path, rig: matlab(path, rig, newer=True),
}
"""Writers by the name of a file; VIC-3D has no tangential distortion."""
