"""Displacement and strain since the first step, with their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from dicflow.engine.node import At, Keep, Node, Pixels, Port, Scope, keeping, parameter
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.stages.accumulate import field_means
from dicflow.stages.frame import frame_attrs, frame_from
from dicflow.stages.smooth import fitted_status

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.frames import Frame
    from dicflow.core.cameras.rigid import RigidMotion
    from dicflow.core.strain.deformation_gradient import Share, SurfaceGradient
    from dicflow.core.uncertainty.covariance import MeasuredPoints
    from dicflow.core.uncertainty.overlap import ShapeFunction

__all__ = ["Deformation"]

_GRID = ("row", "col")
_MEASURES = {
    "engineering": "engineering strain",
    "green_lagrange": "Green–Lagrange strain",
    "hencky": "Hencky strain",
    "euler_almansi": "Euler–Almansi strain",
    "biot": "Biot strain",
}
_SCALARS = {
    "U": "displacement U",
    "V": "displacement V",
    "W": "displacement W",
    "exx": "{measure} εxx",
    "eyy": "{measure} εyy",
    "gxy": "{measure} γxy",
    "e1": "{measure} ε1",
    "e2": "{measure} ε2",
    "angle": "direction of ε1",
    "rotation": "rotation in the surface",
    "von_mises": "von Mises strain (logarithmic, incompressible)",
    "area_change": "area change",
}
_SHARED = ("U", "V", "W", "exx", "eyy", "gxy", "e1", "e2", "von_mises", "area_change")
_SHARES = {"sigma": "σ of the {title}", "calibration": "calibration's share in σ of the {title}"}
_PLACES = {
    "xyz": (("component",), "place"),
    "xyz_reference": (("component",), "place at the first step"),
    "xy": (("image_component",), "place in the image"),
    "xy_reference": (("image_component",), "place in the image at the first step"),
    "gradient": (("out", "in"), "deformation gradient"),
    "covariance": (("pair",), "covariance of the place at this step and the first, upper triangle by rows"),
    "calibration_xyz": (("component",), "calibration's share in σ of the place"),
}
_SINGLE = ("covariance", "calibration_xyz")


class Deformation(Node):
    """Displacement of every point from its place at the first step, and the deformation of the surface around it.

    The deformation gradient comes from least-squares fits over a window, in the tangent planes of the surface at both
    steps. Beside each value stands its standard deviation from the noise of the photographs and, where the rig says
    how uncertain it is, the calibration's share. With one camera everything lies in the plane of the photograph.
    """

    title: ClassVar = "displacement and strain"
    scope: ClassVar = Scope.PAIR
    takes: ClassVar = {
        "points": Port("points", "correlation"),
        "points_first": Port("points", "correlation", at=At.FIRST),
        "rig": Port("rig", optional=True),
        "frame": Port("frame", optional=True),
    }
    gives: ClassVar = "total"
    impl_version: ClassVar = 5

    stage: Literal["deformation"] = "deformation"
    keep: Keep = keeping("always")
    window: Annotated[Pixels, Field(gt=0)] = parameter(50.0, "side of the square window of a strain", unit="px")
    degree: int = parameter(
        1, "of the polynomial in the window; 3 or 5 resolves shorter waves at equal noise, in a larger one", ge=1, le=5
    )
    min_share: float = parameter(0.25, "share of the window's points that must be measured", ge=0, le=1)
    measure: Literal["engineering", "green_lagrange", "hencky", "euler_almansi", "biot"] = parameter(
        "engineering", "measure of strain"
    )
    directions: Literal["material", "global"] = parameter(
        "material", "x and y of the strains: the material's, as they lay at the first step, or the frame's at this one"
    )
    rigid: bool = parameter(False, "take out the rigid-body motion since the first step")

    def run(
        self, points: Product, points_first: Product, rig: Product | None = None, frame: Product | None = None
    ) -> Product:
        """``points_first`` are those of the first step."""
        from dicflow.core.cameras.frames import CAMERA, within
        from dicflow.core.strain.deformation_gradient import surface_gradient
        from dicflow.core.tensors import symmetric, upper
        from dicflow.core.uncertainty.covariance import joint_covariance, points_in_frame

        axes = CAMERA if frame is None else frame_from(frame.attrs)
        points_first = _of_one_noise(points_first, points)
        before = points_in_frame(_points(points_first, first=True), axes)
        after = points_in_frame(_points(points), axes)
        motion = self._motion(before, after)
        along = _moving_frame(motion)
        after, frames = points_in_frame(after, along), (within(along, axes), axes)
        covariance = joint_covariance(after, before, symmetric(points_first["template"]))
        errors = _shares(covariance, points, points_first, (axes, along))
        window = self._window(points_first.attrs["step_size"])
        surface = surface_gradient(before.xyz, after.xyz, [*errors.values()], window, self.degree, self.min_share)
        fields = {**_displacements(before, after, covariance), **self._strains(surface)}
        if rig is not None and "covariance" in rig.attrs:
            fields |= self._calibration(rig, (after.xyz, before.xyz), frames, surface)
        fields |= {"xyz": after.xyz, "xyz_reference": before.xyz, "gradient": surface.gradient}
        fields["covariance"] = upper(covariance)
        return self._product(fields, errors, (points, points_first), motion, frames)

    def _window(self, step_size: float) -> tuple[int, int]:
        from dicflow.core.surfaces.filters import odd_window

        return odd_window((self.window, self.window), step_size)

    def _motion(self, before: MeasuredPoints, after: MeasuredPoints) -> RigidMotion | None:
        """The rigid-body motion that is to be taken out; None where it is not, or no point is left."""
        import numpy as np

        from dicflow.core.cameras.rigid import rigid_motion

        if not self.rigid or not np.isfinite(before.xyz + after.xyz).any():
            return None
        weights = 1.0 / np.maximum(np.trace(before.own + after.own, axis1=-2, axis2=-1), 1e-12)
        try:
            return rigid_motion(before.xyz, after.xyz, np.nan_to_num(weights))
        except ValueError as error:
            raise StageError(f"{error}; look at the points of this step, or use rigid: false") from error

    def _strains(self, surface: SurfaceGradient) -> dict[str, np.ndarray]:
        """All measures of the deformation, and σ of each."""
        from dicflow.core.strain.measures import measured, sigma

        values = measured(surface.gradient, self.measure, self.directions)
        deviations = sigma(surface.gradient, surface.covariance, self.measure, self.directions)
        return {**values._asdict(), **{f"sigma_{name}": part for name, part in deviations._asdict().items()}}

    def _calibration(
        self, rig: Product, states: tuple[np.ndarray, ...], frames: tuple[Frame, Frame], surface: SurfaceGradient
    ) -> dict[str, np.ndarray]:
        """The calibration's share in σ of place, displacement and strain.

        states, frames : the points at this step and the first, and the frames in which they are given
        """
        import numpy as np

        from dicflow.core.strain import calibration_error as shares
        from dicflow.kinds.rig import rig_from_json

        known = np.asarray(np.isfinite(surface.gradient).all(axis=(-1, -2)))
        part = shares.thinned(known)
        after, before = (state[part] for state in states)
        fitted = (after, before) if self.rigid else None
        error = shares.rig_error(rig_from_json(rig.attrs["rig"]), rig.attrs["covariance"], frames, fitted)
        both = error.at(after, before)
        stride = part[0].step
        moved = (both, shares.grid_slopes(both, stride))
        changes = shares.field_changes(
            *moved, surface.gradient[part], surface.response[part], self.measure, self.directions
        )
        found = {
            name: shares.spread_out(np.linalg.norm(changes[name], axis=-1), known.shape, stride)
            for name in (*"XYZ", *_SHARED)
        }
        place = np.stack([found.pop(name) for name in "XYZ"], axis=-1)
        return {"calibration_xyz": place, **{f"calibration_{name}": share for name, share in found.items()}}

    def _product(
        self,
        fields: dict[str, np.ndarray],
        errors: Mapping[ShapeFunction, Share],
        steps: tuple[Product, Product],
        motion: RigidMotion | None,
        frames: tuple[Frame, Frame],
    ) -> Product:
        import numpy as np

        step, first = steps
        moved, strained = np.isfinite(fields["U"]), np.isfinite(fields["exx"])
        window = self._window(first.attrs["step_size"])
        reasons = _reasons(np.maximum(step["status"], first["status"]), moved)
        status = fitted_status(moved, strained, reasons, window, self.degree)
        fields = {**fields, "xy": step["xy"], "xy_reference": first["xy"]}
        fields = {name: _where(moved & strained, values) for name, values in fields.items()}
        unit = "mm" if step.kind == "points" else "px"
        variables = {name: _variable(name, values, unit, _MEASURES[self.measure]) for name, values in fields.items()}
        variables["status"] = Variable(_GRID, status, "1", "why a point has a value, or has none")
        variables |= {name: step.variables[name] for name in ("way", "way_right", "znssd") if name in step}
        laid = first.attrs.get("summary", {}).get("points") or np.isfinite(first["xy"]).all(axis=-1).sum()
        share = (moved & strained).sum() / max(1, int(laid))
        summary = {"valid_share": float(share), **field_means(fields, unit), **_usual_sigmas(fields, unit)}
        facts = {**self._facts(fields, first.attrs, unit), "shape_shares": _variance_shares(errors)}
        attrs = {**facts, "rigid": _six_numbers(motion), "frames": [*map(frame_attrs, frames)], "summary": summary}
        return Product("total", variables, attrs)

    def _facts(self, fields: Mapping[str, np.ndarray], facts: Mapping[str, Any], unit: str) -> dict[str, Any]:
        """What the numbers are, and on how much of the photograph each rests."""
        import numpy as np

        from dicflow.core.strain.deformation_gradient import pixel_size_mm, vsg_px

        window = self._window(facts["step_size"])
        gauge = vsg_px(window[0], facts["step_size"], facts["subset_size"])
        size = pixel_size_mm(fields["xyz_reference"], facts["step_size"])
        size = size[np.isfinite(size)]
        measure = f"{_MEASURES[self.measure]} ({self.directions} directions)"
        return {
            "definition": "precise",
            "unit": unit,
            "measure": self.measure,
            "directions": self.directions,
            "measures": {name: title.format(measure=measure) for name, title in _SCALARS.items()},
            "degree": self.degree,
            "window_points": list(window),
            **{name: facts[name] for name in ("step_size", "subset_size", "shape_function")},
            "vsg_px": gauge,
            "vsg_mm": float(gauge * np.median(size)) if unit == "mm" and size.size else None,
        }


def _shares(
    covariance: np.ndarray, step: Product, first: Product, frames: tuple[Frame, Frame]
) -> dict[ShapeFunction, Share]:
    """The covariance of the points at both steps by the shape functions of the subsets that bring it.

    frames : that of the results, and the one that moves along with what is taken out
    """
    from dicflow.core.strain.deformation_gradient import Share
    from dicflow.core.tensors import symmetric
    from dicflow.core.uncertainty.covariance import joint_covariance, points_in_frame
    from dicflow.core.uncertainty.overlap import overlap

    facts = first.attrs
    grid, other = (facts["subset_size"], facts["step_size"]), facts["shape_function"]
    own = facts.get("shape_function_left", other)
    if own == other:
        return {own: Share(covariance, overlap(*grid, own))}
    after, before = (points_in_frame(_left_share(product), frames[0]) for product in (step, first))
    template = symmetric(first["template"])[..., :2, :2]
    left = joint_covariance(points_in_frame(after, frames[1]), before, template)
    return {own: Share(left, overlap(*grid, own)), other: Share(covariance - left, overlap(*grid, other))}


def _variance_shares(errors: Mapping[ShapeFunction, Share]) -> dict[str, list[float]]:
    """Shares of each shape function in the variance of U, V and W, means over the points."""
    import numpy as np

    from dicflow.core.uncertainty.covariance import displacement_covariance

    if len(errors) == 1:
        return {name: [1.0, 1.0, 1.0] for name in errors}
    variances = np.stack(
        [np.diagonal(displacement_covariance(part.covariance), axis1=-2, axis2=-1) for part in errors.values()]
    )
    known = (variances.sum(axis=0) > 0.0).all(axis=-1)
    shares = variances[:, known] / variances[:, known].sum(axis=0)
    means = shares.mean(axis=1) if known.any() else np.full((len(errors), 3), 1.0 / len(errors))
    return {name: part.tolist() for name, part in zip(errors, means, strict=True)}


def _left_share(product: Product) -> MeasuredPoints:
    """The points of a step with those errors alone that the subsets of the left photographs bring."""
    from dicflow.core.tensors import symmetric
    from dicflow.core.uncertainty.covariance import MeasuredPoints

    return MeasuredPoints(product["xyz"], symmetric(product["covariance_left"]), product["sensitivity"][..., :2])


def _of_one_noise(first: Product, step: Product) -> Product:
    """The points of the first step with the noise that the step was judged by: later photographs tell it better."""
    before, after = (float(part.attrs.get("noise_grey", 1.0)) for part in (first, step))
    if before == after:
        return first
    share = (after / before) ** 2
    names = [name for name in ("covariance", "covariance_left", "template") if name in first]
    scaled = {name: first.variables[name]._replace(values=share * first[name]) for name in names}
    return Product(first.kind, {**first.variables, **scaled}, first.attrs)


def _moving_frame(motion: RigidMotion | None) -> Frame:
    """The frame that moves along with what is taken out."""
    from dicflow.core.cameras.frames import CAMERA
    from dicflow.core.cameras.rigid import undoing

    return CAMERA if motion is None else undoing(motion)


def _points(product: Product, first: bool = False) -> MeasuredPoints:
    """The points of a step with their errors; of one camera, in the plane of its photograph.

    Of one camera the points of the first step are exact, being where the subsets were laid.
    """
    import numpy as np

    from dicflow.core.tensors import symmetric
    from dicflow.core.uncertainty.covariance import MeasuredPoints

    if product.kind == "points":
        return MeasuredPoints(product["xyz"], symmetric(product["covariance"]), product["sensitivity"])
    flat: MeasuredPoints = MeasuredPoints(
        np.pad(product["xy"], [(0, 0), (0, 0), (0, 1)]),
        np.pad(symmetric(product["covariance"]), [(0, 0), (0, 0), (0, 1), (0, 1)]),
        np.pad(product["gradient"], [(0, 0), (0, 0), (0, 1), (0, 0)]),
    )
    return MeasuredPoints(flat.xyz, 0.0 * flat.own, 0.0 * flat.sensitivity) if first else flat


def _displacements(before: MeasuredPoints, after: MeasuredPoints, covariance: np.ndarray) -> dict[str, np.ndarray]:
    """U, V and W, and σ of each."""
    import numpy as np

    from dicflow.core.uncertainty.covariance import displacement_covariance

    values = after.xyz - before.xyz
    values[np.isnan(values).any(axis=-1)] = np.nan
    variances = np.diagonal(displacement_covariance(covariance), axis1=-2, axis2=-1)
    deviations = np.sqrt(np.maximum(variances, 0.0))
    return {
        **{name: values[..., axis] for axis, name in enumerate("UVW")},
        **{f"sigma_{name}": deviations[..., axis] for axis, name in enumerate("UVW")},
    }


def _reasons(status: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Status that agrees with what is known: a value, or a reason why there is none."""
    import numpy as np

    from dicflow.core.status import Status

    reasons = np.where(known, np.minimum(status, Status.FILLED), np.maximum(status, Status.OUTSIDE))
    return np.asarray(reasons, dtype=np.uint8)


def _where(complete: np.ndarray, values: np.ndarray) -> np.ndarray:
    """NaN where the total is not complete."""
    import numpy as np

    return np.where(complete.reshape(complete.shape + (1,) * (values.ndim - 2)), values, np.nan)


def _variable(name: str, values: np.ndarray, unit: str, measure: str) -> Variable:
    """One array of the total with its axes, unit and title; deviations in single precision."""
    import numpy as np

    if name in _PLACES:
        dims, title = _PLACES[name]
        units = {"component": unit, "image_component": "px", "pair": f"{unit}²"}.get(dims[0], "1")
        return Variable((*_GRID, *dims), values.astype(np.float32) if name in _SINGLE else values, units, title)
    share, base = name.split("_", 1) if name.startswith(tuple(_SHARES)) else ("", name)
    title = _SCALARS[base].format(measure=measure)
    units = unit if base in "UVW" else "deg" if base in ("angle", "rotation") else "1"
    if share:
        return Variable(_GRID, values.astype(np.float32), units, _SHARES[share].format(title=title))
    return Variable(_GRID, values, units, title)


def _usual_sigmas(fields: Mapping[str, np.ndarray], unit: str) -> dict[str, float]:
    """Median σ of displacements and strains; absent without any."""
    import numpy as np

    names = {f"sigma_{name}": f"_{unit}" for name in "UVW"} | {f"sigma_{name}": "" for name in ("exx", "eyy", "gxy")}
    known = {name: fields[name][np.isfinite(fields[name])] for name in names}
    return {f"{name}{names[name]}": float(np.median(values)) for name, values in known.items() if values.size}


def _six_numbers(motion: RigidMotion | None) -> dict[str, list[float]] | None:
    """The rigid-body motion that was taken out."""
    if motion is None:
        return None
    return {
        "rotation_deg": motion.rotation_deg.tolist(),
        "translation": motion.translation.tolist(),
        "centre": motion.centre.tolist(),
    }
