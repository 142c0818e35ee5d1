"""The calibrated rig from a file of another program, or of dicflow."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from dicflow.engine.node import At, InputFile, Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import InputError
from dicflow.kinds.images import Images
from dicflow.kinds.rig import CalibratedRig

if TYPE_CHECKING:
    from dicflow.io.calibrations.draft import Calibration

__all__ = ["RigFile"]


class RigFile(Node):
    """Read a calibration of both cameras: OpenCV, MatchID, VIC-3D, DICe, OpenCorr, pyvale, MATLAB or dicflow's own.

    The photographs say their size where the file does not, and must have the file's where it does. How exact the
    calibration is, only dicflow's own files say.
    """

    title: ClassVar = "read the rig"
    scope: ClassVar = Scope.RIG
    takes: ClassVar = {"images": Port("images", at=At.FIRST, optional=True)}
    gives: ClassVar = "rig"

    stage: Literal["rig_file"] = "rig_file"
    file: InputFile = parameter(
        ..., "calibration: OpenCV YAML or XML, .caldat, VIC-3D .xml or .z3d, DICe .xml, OpenCorr or pyvale .csv, .mat"
    )

    def uses(self) -> tuple[str, ...]:
        from dicflow.io.calibrations import calibration_modules

        return calibration_modules()

    def check(self, path: Path) -> dict[str, Any]:
        from dicflow.io.calibrations.read import parse_calibration

        draft = parse_calibration(path)
        return {"sized": draft.left.size is not None and draft.right.size is not None}

    def agree(
        self,
        facts: Mapping[Path, Mapping[str, Any]],
        steps: Mapping[str, Mapping[str, Path]],
        inputs: Mapping[str, tuple[str, ...]],
    ) -> None:
        for path, fact in facts.items():
            if not fact["sized"] and "images" not in inputs:
                raise InputError(
                    f"{path}: does not say the size of the photographs; name the stage of the photographs as 'images'"
                )

    def run(self, file_path: Path, images: Product | None = None) -> Product:
        from dicflow.io.calibrations.read import read_calibration

        found = read_calibration(file_path, None if images is None else Images.read(images).size)
        summary = _summary(found)
        return CalibratedRig.write(
            found.rig,
            _verdict(file_path, found, summary),
            summary,
            covariance=found.covariance,
            program=found.program,
            warnings=found.warnings,
        )


def _summary(found: Calibration) -> dict[str, float]:
    import numpy as np

    from dicflow.core.cameras.camera import rotation_angle_deg

    return {
        "baseline_mm": float(np.linalg.norm(found.rig.translation)),
        "angle_deg": rotation_angle_deg(found.rig.rotation),
    }


def _verdict(path: Path, found: Calibration, summary: Mapping[str, float]) -> str:
    """What was read, as a sentence, with what the user should know of it."""
    width, height = found.rig.left.size
    origin = (
        f"read from {path.name} of {found.program}: {width} × {height} px, cameras {summary['baseline_mm']:.1f} mm and "
        f"{summary['angle_deg']:.1f}° apart"
    )
    return "; ".join([origin, *(f"note that {warning}" for warning in found.warnings)])
