"""Displacement and strain since the first step, with their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, cast

from pydantic import AfterValidator, Field

from dicflow.engine.node import At, Keep, Node, Pixels, Port, Scope, keeping, parameter
from dicflow.engine.product import Product
from dicflow.engine.share import free_threads
from dicflow.errors import ConfigurationError, StageError
from dicflow.kinds.frame import ResultFrame
from dicflow.kinds.points import Points
from dicflow.kinds.quantities import (
    MEASURES,
    QUANTITIES,
    Quantity,
    further_quantity,
    gradient_functions,
    strain_function,
    strain_measure,
)
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.scale import Scale
from dicflow.kinds.total import (
    DEGREE,
    VSG,
    Total,
    TotalFacts,
    field_means,
    frames_to_json,
    rigid_motion_to_json,
)
from dicflow.stages._deformed import (
    beyond_noise,
    combined,
    consistent_status,
    degrees,
    displacements,
    figures_sentence,
    median_errors,
    shares,
)
from dicflow.stages._point_errors import (
    bias_of_displacements,
    bias_of_places,
    errors_as_seen,
    errors_by_shape,
    variance_shares,
)
from dicflow.stages._scaled import in_unit, scale_shares

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.frames import Frame
    from dicflow.core.cameras.rigid import RigidMotion
    from dicflow.core.strain.deformation_gradient import ErrorShare, SurfaceGradient
    from dicflow.core.strain.degree_choice import ChosenGradient
    from dicflow.core.strain.measures import GradientMeasures
    from dicflow.core.strain.small_jumps import GridOfSubsets
    from dicflow.core.uncertainty.covariance import MeasuredPoints
    from dicflow.core.uncertainty.overlap import ShapeFunction

__all__ = ["Deformation", "sentence"]


def _known_measure(name: str) -> str:
    try:
        return strain_measure(name).name
    except ConfigurationError as error:
        raise ValueError(str(error)) from error


def _known_quantity(name: str) -> str:
    try:
        return further_quantity(name).name
    except ConfigurationError as error:
        raise ValueError(str(error)) from error


class _Motion(NamedTuple):
    """The removed rigid-body motion, None if it stays in, and the frames of the step and of the first one."""

    removed: RigidMotion | None
    frames: tuple[Frame, Frame]


class Deformation(Node):
    """Displacement of every point from its place at the first step, and the deformation of the surface around it.

    The deformation gradient comes from least-squares fits over a window, in the tangent planes of the surface at both
    steps. Each value has a standard deviation by the noise of the photographs, an estimate of the bias that remains,
    both combined as its uncertainty u, and, if the uncertainty of the rig is known, the calibration's share. With one
    camera everything lies in the plane of the photograph, in pixels, or in millimetres if its scale is known.
    """

    title: ClassVar = "displacement and strain"
    scope: ClassVar = Scope.PAIR
    takes: ClassVar = {
        "points": Port("points", "correlation"),
        "points_first": Port("points", "correlation", at=At.FIRST),
        "rig": Port("rig", optional=True),
        "frame": Port("frame", optional=True),
        "scale": Port("scale", optional=True),
    }
    gives: ClassVar = "total"
    impl_version: ClassVar = 7

    stage: Literal["deformation"] = "deformation"
    keep: Keep = keeping("always")
    window: Annotated[Pixels, Field(gt=0)] = parameter(50.0, "side of the square window of a strain", unit="px")
    degree: Annotated[int, Field(ge=1, le=5)] | Literal["auto"] = parameter(
        "auto",
        "of the polynomial in the window, 1 to 5; auto: 1, and up to 3 at points where its bias would count beside σ",
    )
    min_share: float = parameter(0.25, "share of the window's points that must be measured", ge=0, le=1)
    measure: Annotated[str, AfterValidator(_known_measure)] = parameter(
        "engineering", f"measure of strain: {', '.join(MEASURES)}, or that of an installed package"
    )
    directions: Literal["material", "global"] = parameter(
        "material", "x and y of the strains: the material's, as they lay at the first step, or the frame's at this one"
    )
    further: tuple[Annotated[str, AfterValidator(_known_quantity)], ...] = parameter(
        (), "further quantities of the deformation gradient, of installed packages, by name"
    )
    rigid: bool = parameter(False, "remove the rigid-body motion since the first step")

    def uses(self) -> tuple[str, ...]:
        quantities = [further_quantity(name).function for name in self.further]
        return tuple(filter(None, [strain_measure(self.measure).function, *quantities]))

    def run(
        self,
        points: Product,
        points_first: Product,
        rig: Product | None = None,
        frame: Product | None = None,
        scale: Product | None = None,
    ) -> Product:
        """``points_first`` are those of the first step."""
        import numpy as np

        from dicflow.core.cameras.frames import LEFT_CAMERA, compose_frames
        from dicflow.core.strain.crack_ends import with_crack_ends
        from dicflow.core.strain.deformation_gradient import measured_surface
        from dicflow.core.strain.degree_choice import candidate_fits, chosen_gradient
        from dicflow.core.strain.place_bias import with_bias_of_places
        from dicflow.core.strain.point_scatter import scatter_of_points, with_scatter_as_bias
        from dicflow.core.strain.unseen_jumps import cut_by_jumps, unseen_jumps
        from dicflow.core.tensors import upper_triangle
        from dicflow.core.uncertainty.covariance import joint_covariance, points_in_frame, with_errors

        axes = LEFT_CAMERA if frame is None else ResultFrame.read(frame).axes
        step = in_unit(Points.read(points), scale)
        first = in_unit(Points.read(points_first), scale).with_noise_of(step)
        before = points_in_frame(first.measured_at_first_step(), axes)
        after = points_in_frame(step.measured(), axes)
        motion = self._motion(before, after)
        along = _moving_frame(motion)
        after = points_in_frame(after, along)
        before = with_errors(before, after.sensitivity.shape[-1])
        covariance = joint_covariance(after, before, step.template)
        errors = errors_by_shape(covariance, step, first, (axes, along))
        surface_of = partial(measured_surface, before.xyz, parts=first.parts, min_share=self.min_share)
        (lost, grid), frames = _jumps(step, first), (compose_frames(along, axes), axes)
        measured, places = surface_of(after.xyz, [*errors.values()]), bias_of_places(step, frames[0].rotation)
        seen = scatter_of_points(measured, grid, [*errors], places, step.misfit_share)
        if not all(axis.is_as_stated for axis in seen):
            covariance, errors = errors_as_seen(covariance, errors, seen, first.grid)
            measured = surface_of(after.xyz, [*errors.values()])
        cut = cut_by_jumps(measured, lost, grid, self._window(first))
        if cut.any():
            step, after = step.lost_at(cut), after._replace(xyz=np.where(cut[..., None], np.nan, after.xyz))
            measured = surface_of(after.xyz, [*errors.values()])
        measured = measured._replace(threads=free_threads())
        jumps = unseen_jumps(measured, lost | cut, grid, max(self._window(first)))
        fits = candidate_fits(self._window(first), self.degree)
        chosen = with_crack_ends(chosen_gradient(measured, fits, jumps), measured, lost | cut, fits[0])
        chosen = with_scatter_as_bias(with_bias_of_places(chosen, measured, places), seen)
        surface = chosen.surface
        fields = displacements(before, after, covariance)
        fields |= beyond_noise(bias_of_displacements(places, jumps), fields, seen)
        fields |= self._strains(chosen)
        fields |= combined(fields)
        if scale is not None:
            fields |= scale_shares(Scale.read(scale).relative_u, self._quantities(), fields, after.xyz)
        elif rig is not None and step.in_space:
            fields |= self._calibration(CalibratedRig.read(rig), (after.xyz, before.xyz), frames, surface)
        fields |= {"xyz": after.xyz, "xyz_reference": before.xyz, "gradient": surface.gradient}
        fields["covariance"] = upper_triangle(covariance)
        product = self._product(fields, errors, (step, first), _Motion(motion, frames), chosen)
        return product if scale is None else Total.read(product).with_scale(Scale.read(scale).facts)

    def _window(self, points: Points) -> tuple[int, int]:
        """Rows and columns of the window of a strain [points]."""
        from dicflow.core.surfaces.filters import odd_window

        return odd_window((self.window, self.window), points.grid.step_size)

    def _motion(self, before: MeasuredPoints, after: MeasuredPoints) -> RigidMotion | None:
        """The rigid-body motion to remove; None if it stays in, or no point is left."""
        import numpy as np

        from dicflow.core.cameras.rigid import rigid_motion

        if not self.rigid or not np.isfinite(before.xyz + after.xyz).any():
            return None
        weights = 1.0 / np.maximum(np.trace(before.step_covariance + after.step_covariance, axis1=-2, axis2=-1), 1e-12)
        try:
            return rigid_motion(before.xyz, after.xyz, np.nan_to_num(weights))
        except ValueError as error:
            raise StageError(f"{error}; look at the points of this step, or use rigid: false") from error

    def _strains(self, chosen: ChosenGradient) -> dict[str, np.ndarray]:
        """All quantities of the deformation gradient, σ and remaining bias of each."""
        import numpy as np

        from dicflow.core.tensors import on_grid
        from dicflow.core.uncertainty.covariance import sigma_along

        known = np.asarray(np.isfinite(chosen.surface.gradient).all(axis=(-1, -2)))
        gradient, measures = chosen.surface.gradient[known], self._measures()
        found = measures.values(gradient)
        derivatives = measures.derivatives(gradient)
        biased = np.trace(chosen.bias[known], axis1=-2, axis2=-1) > 0.0
        bias = np.zeros(derivatives.shape[:2])
        bias[biased] = sigma_along(chosen.bias[known][biased][:, None], derivatives[biased])
        sigma = sigma_along(chosen.surface.covariance[known][:, None], derivatives)
        for prefix, deviations in (("sigma_", sigma), ("bias_", bias)):
            found |= {f"{prefix}{name}": part for name, part in zip(measures.names, deviations.T, strict=True)}
        return {name: on_grid(values, known) for name, values in found.items()}

    def _measures(self) -> GradientMeasures:
        """The measures of deformation gradients."""
        from dicflow.core.strain.measures import GradientMeasures

        return GradientMeasures(strain_function(self.measure), self.directions, gradient_functions(self.further))

    def _quantities(self) -> dict[str, Quantity]:
        """All quantities by name."""
        return {**QUANTITIES, **{name: further_quantity(name) for name in self.further}}

    def _calibration(
        self,
        rig: CalibratedRig,
        states: tuple[np.ndarray, ...],
        frames: tuple[Frame, Frame],
        surface: SurfaceGradient,
    ) -> dict[str, np.ndarray]:
        """The calibration's share in σ of place, displacement and strain; empty if unknown.

        states, frames : the points at this step and the first, and the frames in which they are given
        """
        import numpy as np

        from dicflow.core.strain import calibration_error as shares

        if rig.covariance is None:
            return {}
        known = np.asarray(np.isfinite(surface.gradient).all(axis=(-1, -2)))
        part = shares.thinned_grid(known)
        after, before = (state[part] for state in states)
        fitted = (after, before) if self.rigid else None
        error = shares.rig_error(rig.cameras, rig.covariance, frames, fitted)
        both = error.changes_at(after, before)
        stride = part[0].step
        moved = (both, shares.slope_changes(both, stride))
        changes = shares.field_changes(*moved, surface.gradient[part], surface.response[part], self._measures())
        names = (*"XYZ", *(name for name, quantity in self._quantities().items() if quantity.calibrated))
        found = {
            name: shares.nearest_on_grid(np.linalg.norm(changes[name], axis=-1), known.shape, stride) for name in names
        }
        place = np.stack([found.pop(name) for name in "XYZ"], axis=-1)
        return {"calibration_xyz": place, **{f"calibration_{name}": share for name, share in found.items()}}

    def _product(
        self,
        fields: dict[str, np.ndarray],
        errors: Mapping[ShapeFunction, ErrorShare],
        steps: tuple[Points, Points],
        motion: _Motion,
        chosen: ChosenGradient,
    ) -> Product:
        import numpy as np

        from dicflow.kinds.status import fitted_status, known_or_nan

        step, first = steps
        moved, strained = np.isfinite(fields["U"]), np.isfinite(fields["exx"])
        reasons = consistent_status(np.maximum(step["status"], first["status"]), moved)
        status = fitted_status(
            moved, strained, reasons, self._window(first), 1 if self.degree == "auto" else self.degree
        )
        fields = {**fields, "xy": step["xy"], "xy_reference": first["xy"]}
        fields = {name: known_or_nan(moved & strained, values) for name, values in fields.items()}
        share = (moved & strained).sum() / max(1, first.points_in_region)
        means = field_means(fields, step.unit)
        further = {
            **self._facts(fields, first, step.unit),
            **degrees(chosen.degree[moved & strained]),
            "window_shares": shares(chosen.window[moved & strained]),
            "shape_shares": variance_shares(errors),
            "rigid": rigid_motion_to_json(motion.removed),
            "frames": frames_to_json(motion.frames),
            "summary": {"valid_share": float(share), **means, **median_errors(fields, step.unit)},
        }
        beside = {name: step.product.variables[name] for name in ("way", "way_right", "znssd") if name in step}
        if self.degree == "auto":
            beside["degree"] = DEGREE(np.where(moved & strained, chosen.degree, np.uint8(0)))
            beside["vsg"] = VSG(known_or_nan(moved & strained, _gauges(chosen, first)))
        return Total.write(fields, status, TotalFacts("precise", step.unit, self._titles(), further), beside)

    def _titles(self) -> dict[str, str]:
        """Each quantity in words."""
        measure = f"{strain_measure(self.measure).title} ({self.directions} directions)"
        return {name: quantity.title.format(measure=measure) for name, quantity in self._quantities().items()}

    def _facts(self, fields: Mapping[str, np.ndarray], first: Points, unit: str) -> dict[str, Any]:
        """Settings of the computation, and the virtual strain gauge."""
        import numpy as np

        from dicflow.core.strain.deformation_gradient import pixel_size_mm
        from dicflow.core.strain.gauge import vsg_px

        window, grid = self._window(first), first.grid
        gauge = vsg_px(window[0], grid.step_size, grid.subset_size)
        size = pixel_size_mm(fields["xyz_reference"], grid.step_size)
        size = size[np.isfinite(size)]
        return {
            "measure": self.measure,
            "directions": self.directions,
            "window_points": list(window),
            **grid._asdict(),
            "vsg_px": gauge,
            "vsg_mm": float(gauge * np.median(size)) if unit == "mm" and size.size else None,
        }


def _jumps(step: Points, first: Points) -> tuple[np.ndarray, GridOfSubsets]:
    """Points (row, col) at which a jump was found, and the grid of subsets."""
    from dicflow.core.status import Status
    from dicflow.core.strain.small_jumps import GridOfSubsets

    lost, shape_function = step["status"] == Status.DISCONTINUITY, cast(Any, step.left_shape_function)
    return lost, GridOfSubsets(first.grid.subset_size, first.grid.step_size, shape_function)


def _moving_frame(motion: RigidMotion | None) -> Frame:
    """The frame that moves with the removed rigid-body motion."""
    from dicflow.core.cameras.frames import LEFT_CAMERA
    from dicflow.core.cameras.rigid import co_moving_frame

    return LEFT_CAMERA if motion is None else co_moving_frame(motion)


def _gauges(chosen: ChosenGradient, first: Points) -> np.ndarray:
    """Sides of the virtual strain gauges (row, col) [px]."""
    import numpy as np

    from dicflow.core.strain.gauge import vsg_px

    sides = [vsg_px(points, first.grid.step_size, first.grid.subset_size) for points in range(chosen.window.max() + 1)]
    return np.array(sides, dtype=np.float32)[chosen.window]


def sentence(stage: Deformation, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    measure, side = strain_measure(stage.measure), f"{stage.window:g}"
    cited = "" if measure.name == "engineering" else " [seth1961, hill1968]"
    along = {"material": "the directions of the material", "global": "the directions of the coordinate system"}
    degree = "1 to 3, at each point the first whose estimated bias is at most a quarter of its standard deviation,"
    degree = degree if stage.degree == "auto" else f"{stage.degree}"
    text = (
        f"The deformation gradient of the surface since the first step was computed from polynomials of degree "
        f"{degree} fitted to the points in windows of {side} × {side} px [savitzky1964]; the measure "
        f"of strain is {measure.title}{cited}, in {along[stage.directions]}."
    )
    if stage.rigid:
        text += " The rigid-body motion was removed from the displacement [kabsch1976]."
    return text if product is None else text + figures_sentence(Total.read(product))
