"""The calibrated rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from dicflow.engine.product import Product
from dicflow.kinds.kind import Kind

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.camera import Camera, Rig

__all__ = ["CalibratedRig", "rig_from_json", "rig_to_json"]


class CalibratedRig(Kind):
    """Both cameras, their relative pose, and their uncertainty."""

    KINDS: ClassVar = ("rig",)

    @classmethod
    def write(
        cls,
        rig: Rig,
        verdict: str,
        summary: Mapping[str, float | int],
        *,
        covariance: np.ndarray | None = None,
        pairs: Sequence[Mapping[str, Any]] = (),
        coverage: Mapping[str, float] | None = None,
        program: str = "",
        warnings: Sequence[str] = (),
    ) -> Product:
        """A product of a rig.

        verdict : one sentence on how good it is
        covariance : (24, 24) — of :data:`~dicflow.core.cameras.rig_parameters.PARAMETERS`; None if unknown
        pairs : for each pair of board photographs its name, whether it was used, its errors [px], and where it has
            any single corners that are not used, ``left_out`` by the user: left and right → places [px], and
            ``gross``: left and right → places and distances [px]
        coverage : share of each camera's frame that the boards cover
        program : the one that wrote the calibration; "" for a calibration by dicflow
        """
        from dicflow.core.cameras.rig_parameters import PARAMETERS

        known: dict[str, Any] = {}
        if covariance is not None:
            known |= {"parameters": list(PARAMETERS), "covariance": covariance.tolist()}
        if coverage is not None:
            known["coverage"] = dict(coverage)
        if program:
            known["program"] = program
        if _is_doubtful(verdict):
            warnings = [f"the calibration is {verdict}", *warnings]
        if program or warnings:
            known["warnings"] = list(warnings)
        facts = {"rig": rig_to_json(rig), "pairs": [dict(pair) for pair in pairs], "verdict": verdict}
        return Product("rig", {}, {**facts, **known, "summary": dict(summary)})

    @property
    def cameras(self) -> Rig:
        """Both cameras and their relative pose."""
        return rig_from_json(self.product.attrs["rig"])

    @property
    def covariance(self) -> np.ndarray | None:
        """Covariance (24, 24) of the rig's parameters; None if unknown."""
        import numpy as np

        found = self.product.attrs.get("covariance")
        return None if found is None else np.array(found, dtype=float)

    @property
    def verdict(self) -> str:
        """One sentence on how good the rig is."""
        return str(self.product.attrs["verdict"])

    @property
    def is_doubtful(self) -> bool:
        """Whether the verdict asks for better photographs of the board."""
        return _is_doubtful(self.verdict)

    @property
    def warnings(self) -> Sequence[str]:
        """What is doubtful of it, and what a user of another program's calibration should know."""
        return self.product.warnings

    @property
    def pairs(self) -> Sequence[Mapping[str, Any]]:
        """For each pair of board photographs its name, whether it was used, and its errors [px]."""
        return tuple(self.product.attrs["pairs"])

    @property
    def coverage(self) -> Mapping[str, float]:
        """Share of each camera's frame that the boards cover; empty if unknown."""
        found: Mapping[str, float] = self.product.attrs.get("coverage", {})
        return found

    def refined(
        self,
        rig: Rig,
        covariance: np.ndarray,
        verdict: str,
        summary: Mapping[str, float | int],
        warnings: Sequence[str] = (),
    ) -> Product:
        """The product of this rig after it was refined; parameters as for :meth:`write`."""
        found = CalibratedRig.write(
            rig, verdict, summary, covariance=covariance, program=self.program, warnings=warnings
        )
        offset = {"offset": self.product.attrs["offset"]} if "offset" in self.product.attrs else {}
        return Product("rig", {}, {**found.attrs, **offset})

    def with_windows(self, rig: Rig, offset: Mapping[str, Sequence[float]]) -> Product:
        """The product for windows of the cameras' sensors.

        rig : for photographs of these windows
        offset : left and right → first pixel (x, y) of these photographs in those of the boards [px]
        """
        places = {side: list(place) for side, place in offset.items()}
        return Product("rig", {}, {**self.product.attrs, "rig": rig_to_json(rig), "offset": places})

    def offset(self, side: str) -> tuple[float, float]:
        """First pixel (x, y) of the left or right camera's photographs in those of the boards [px]."""
        x, y = self.product.attrs.get("offset", {}).get(side, (0.0, 0.0))
        return x, y

    @property
    def program(self) -> str:
        """Program that wrote the calibration; "" for dicflow."""
        return str(self.product.attrs.get("program", ""))


def _is_doubtful(verdict: str) -> bool:
    return verdict.startswith(("poor", "usable"))


def rig_to_json(rig: Rig) -> dict[str, Any]:
    """The rig in JSON values; the numbers come back bit for bit.

    ``rotation`` and ``translation_mm`` carry the left camera's frame into the right one's: X1 = R @ X0 + T.
    """
    import numpy as np

    return {
        "left": _camera_to_json(rig.left),
        "right": _camera_to_json(rig.right),
        "rotation": np.asarray(rig.rotation, dtype=float).tolist(),
        "translation_mm": np.asarray(rig.translation, dtype=float).tolist(),
    }


def rig_from_json(values: Mapping[str, Any]) -> Rig:
    """The inverse of :func:`rig_to_json`. Raises KeyError for a missing entry and ValueError for a wrong shape."""
    from dicflow.core.cameras.camera import Rig

    return Rig(
        left=_camera_from_json(values["left"]),
        right=_camera_from_json(values["right"]),
        rotation=_numbers(values["rotation"], (3, 3), "rotation"),
        translation=_numbers(values["translation_mm"], (3,), "translation_mm"),
    )


def _camera_to_json(camera: Camera) -> dict[str, Any]:
    import numpy as np

    return {
        "matrix": np.asarray(camera.matrix, dtype=float).tolist(),
        "distortion": np.asarray(camera.distortion, dtype=float).tolist(),
        "size": [int(side) for side in camera.size],
    }


def _camera_from_json(values: Mapping[str, Any]) -> Camera:
    from dicflow.core.cameras.camera import Camera

    width, height = values["size"]
    return Camera(
        matrix=_numbers(values["matrix"], (3, 3), "matrix"),
        distortion=_numbers(values["distortion"], (5,), "distortion"),
        size=(int(width), int(height)),
    )


def _numbers(values: Any, shape: tuple[int, ...], name: str) -> np.ndarray:
    import numpy as np

    array = np.asarray(values, dtype=float)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{name} is not {' × '.join(map(str, shape))} finite numbers")
    return array
