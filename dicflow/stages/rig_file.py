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
from dicflow.stages._window import OFFSET, Offset, with_windows

if TYPE_CHECKING:
    from dicflow.io.calibrations.draft import Calibration

__all__ = ["RigFile", "sentence"]


class RigFile(Node):
    """Read a calibration of both cameras: OpenCV, MatchID, VIC-3D, DICe, OpenCorr, pyvale, MATLAB or dicflow's own.

    The photographs give their size if the file does not; otherwise they must have the size in the file. Only dicflow's
    own files hold the covariance of the calibration.
    """

    title: ClassVar = "read the rig"
    scope: ClassVar = Scope.RIG
    takes: ClassVar = {"images": Port("images", at=At.FIRST, optional=True)}
    gives: ClassVar = "rig"
    is_quick: ClassVar = True

    stage: Literal["rig_file"] = "rig_file"
    file: InputFile = parameter(
        ..., "calibration: OpenCV YAML or XML, .caldat, VIC-3D .xml or .z3d, DICe .xml, OpenCorr or pyvale .csv, .mat"
    )

    offset: Offset | None = parameter(None, OFFSET, unit="px")

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
                    f"{path}: does not give the size of the photographs; name the stage of the photographs as 'images'"
                )

    def run(self, file_path: Path, images: Product | None = None) -> Product:
        from dicflow.io.calibrations.read import read_calibration

        photographs = None if images is None else Images.read(images)
        calibration = read_calibration(file_path, *self._sizes(file_path, photographs))
        summary = _summary(calibration)
        product = CalibratedRig.write(
            calibration.rig,
            _verdict(file_path, calibration, summary),
            summary,
            covariance=calibration.covariance,
            program=calibration.program,
            warnings=calibration.warnings,
        )
        return with_windows(product, self.offset, images)

    def _sizes(self, path: Path, images: Images | None) -> tuple[tuple[int, int], ...]:
        """Sizes of the photographs that were calibrated with; those of windows reach to their far corners.

        Empty without photographs, or where these are windows and the file gives the sizes.
        """
        if images is None or (self.offset is not None and self.check(path)["sized"]):
            return ()
        offset = self.offset or Offset()
        places = {"left": offset.left, "right": offset.right}
        return tuple(
            (image.shape[1] + round(places[side][0]), image.shape[0] + round(places[side][1]))
            for side, image in images.sides
        )


def _summary(calibration: Calibration) -> dict[str, float]:
    import numpy as np

    from dicflow.core.cameras.camera import rotation_angle_deg

    return {
        "baseline_mm": float(np.linalg.norm(calibration.rig.translation)),
        "angle_deg": rotation_angle_deg(calibration.rig.rotation),
    }


def _verdict(path: Path, calibration: Calibration, summary: Mapping[str, float]) -> str:
    """Origin and geometry of the rig in one sentence, with the warnings about the file."""
    width, height = calibration.rig.left.size
    origin = (
        f"read from {path.name} of {calibration.program}: {width} × {height} px, cameras "
        f"{summary['baseline_mm']:.1f} mm and {summary['angle_deg']:.1f}° apart"
    )
    return "; ".join([origin, *(f"note that {warning}" for warning in calibration.warnings)])


def sentence(stage: RigFile, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    source = "another program" if product is None else CalibratedRig.read(product).program
    return f"The calibration of the cameras was taken from a file of {source}."
