"""Points in space and their uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

from dicflow.engine.product import Product, Variable
from dicflow.kinds.correlation import Correlation, SubsetGrid, part_variables, parts_of
from dicflow.kinds.kind import GRID, Kind, Layout, warned_if_lost
from dicflow.kinds.stereo import Stereo

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.triangulate import Triangulated
    from dicflow.core.parts import Parts
    from dicflow.core.uncertainty.covariance import MeasuredPoints

__all__ = ["PointErrors", "Points"]

_LAYOUTS = {
    "xyz": Layout((*GRID, "component"), "mm", "position"),
    "xy": Layout((*GRID, "image_component"), "px", "place in the left photograph"),
    "xy_right": Layout((*GRID, "image_component"), "px", "place in the right photograph"),
    "covariance": Layout((*GRID, "pair"), "mm²", "covariance XX, XY, XZ, YY, YZ, ZZ"),
    "covariance_left": Layout((*GRID, "pair"), "mm²", "share of the left photographs in the covariance"),
    "sensitivity": Layout((*GRID, "component", "error"), "mm/px", "motion per error of the template"),
    "reprojection": Layout(GRID, "px", "reprojection error"),
    "template": Layout((*GRID, "error_pair"), "px²", "covariance of the template's error"),
    "bias": Layout((*GRID, "component", "image_component"), "mm", "remaining bias, by that of the place along x and y"),
    "znssd": Layout(GRID, "1", "ZNSSD, the larger one of both photographs"),
    "status": Layout(GRID, "1", "valid, or why the place is unknown"),
}


_MM_PER_PX = "mm_per_px"


class PointErrors(NamedTuple):
    """Errors of the points of one step.

    own : (row, col, 3, 3) — covariance by all noise but the template's [mm²]
    left : (row, col, 3, 3) — share of the left photographs in it [mm²]
    sensitivity : (row, col, 3, 2) — motion of a point per error of the template [mm/px]
    template : (row, col, 3) — covariance of this error, xx, xy, yy [px²]
    bias : (row, col, 3, 2) — motion by one standard deviation of the bias that the left place has along x, and along
        y [mm]; None if unknown

    Where the shape functions left and right differ the template has two such errors: (row, col, 3, 4) and
    (row, col, 10), the upper triangle of the covariance of both.
    """

    own: np.ndarray
    left: np.ndarray
    sensitivity: np.ndarray
    template: np.ndarray
    bias: np.ndarray | None = None


class Points(Kind):
    """Material points at one step: in space with two cameras, in the plane of the photograph with one."""

    KINDS: ClassVar = ("points", "correlation")

    @classmethod
    def write(
        cls,
        found: Triangulated,
        errors: PointErrors,
        status: np.ndarray,
        sources: tuple[Correlation, Stereo],
        facts: Mapping[str, Any],
    ) -> Product:
        """A product of points in space, NaN where a point is not valid.

        status : (row, col) — of both photographs
        sources : the points in the left and the right photograph
        facts : further attributes: reasons, text, summary
        """
        import numpy as np

        from dicflow.core.status import Status
        from dicflow.core.tensors import upper_triangle
        from dicflow.kinds.status import known_or_nan

        correlation, stereo = sources
        kept = status <= Status.FILLED
        measured = {
            "xyz": found.xyz,
            "xy": correlation["xy"],
            "xy_right": stereo["xy"],
            "covariance": upper_triangle(errors.own),
            "covariance_left": upper_triangle(errors.left),
            "sensitivity": errors.sensitivity,
            "reprojection": found.reprojection.astype(np.float32),
        }
        worse = np.fmax(correlation["znssd"], stereo["znssd"]).astype(np.float32)
        variables: dict[str, Variable] = {
            **{name: _LAYOUTS[name](known_or_nan(kept, values)) for name, values in measured.items()},
            "epipolar": stereo.product.variables["epipolar"],
            "template": _LAYOUTS["template"](errors.template),
            "znssd": _LAYOUTS["znssd"](worse),
            **({} if errors.bias is None else {"bias": _LAYOUTS["bias"](errors.bias.astype(np.float32))}),
            "way": correlation.product.variables["way"],
            "way_right": stereo.product.variables["way"],
            "status": _LAYOUTS["status"](status),
        }
        parts, part_attrs = part_variables(correlation.product)
        attrs = {
            "step_size": correlation.grid.step_size,
            "subset_size": correlation.grid.subset_size,
            "image_size": list(correlation.image_size),
            "noise_grey": correlation.noise_grey,
            "shape_function": stereo.grid.shape_function,
            "shape_function_left": correlation.grid.shape_function,
            "depth_mm": _median_depth(variables["xyz"].values),
            "misfit_share": _misfit_share(correlation, stereo),
        }
        product = Product("points", {**variables, **parts}, {**attrs, **part_attrs, **facts})
        return warned_if_lost(product) if (stereo["status"] <= Status.FILLED).any() else product

    @property
    def unit(self) -> str:
        """Unit of places: mm in space or with a scale, px in the plane of one camera's photograph."""
        return "mm" if self.in_space or self._pixel != 1.0 else "px"

    def in_mm(self, mm_per_px: float) -> Self:
        """These points of one camera in millimetres of the plane that it looks at."""
        attrs = {**self.product.attrs, _MM_PER_PX: mm_per_px}
        return type(self)(Product(self.product.kind, self.product.variables, attrs))

    @property
    def _pixel(self) -> float:
        """Size of a pixel in the unit of places, with one camera."""
        return float(self.product.attrs.get(_MM_PER_PX, 1.0))

    @property
    def image_width(self) -> int:
        """Of the left photograph [px]."""
        return int(self.product.attrs["image_size"][0])

    @property
    def in_space(self) -> bool:
        """Whether two cameras measured them."""
        return self.product.kind == "points"

    @property
    def grid(self) -> SubsetGrid:
        """The grid of subsets; with two cameras the shape function is that of the right photograph."""
        attrs = self.product.attrs
        return SubsetGrid(attrs["step_size"], attrs["subset_size"], attrs["shape_function"])

    @property
    def left_shape_function(self) -> str:
        """Shape function of the subsets in the left photographs."""
        return str(self.product.attrs.get("shape_function_left", self.grid.shape_function))

    @property
    def noise_grey(self) -> float:
        """Noise from which the errors were computed [grey levels]."""
        return float(self.product.attrs.get("noise_grey", 1.0))

    @property
    def misfit_share(self) -> float:
        """Share of misfit in the variance of the places in the photographs of the step, median; 0 where unknown."""
        return float(self.product.attrs.get("misfit_share", _misfit_share(self) if "misfit" in self else 0.0))

    @property
    def depth_mm(self) -> float | None:
        """Median distance of the points in front of the left camera; None if it is unknown, or in the plane."""
        found: float | None = self.product.attrs.get("depth_mm")
        return found

    @property
    def parts(self) -> Parts:
        """The parts of the grid; of points at the first step."""
        return parts_of(self.product)

    @property
    def template(self) -> np.ndarray:
        """Covariance matrices (row, col, d, d) of the errors of the template [px²]."""
        from dicflow.core.tensors import symmetric

        return symmetric(self["template_own" if "template_own" in self else "template"])

    @property
    def bias(self) -> np.ndarray | None:
        """Motion (row, col, 3, 2) by one standard deviation of the place's bias along x and y; None if unknown."""
        import numpy as np

        if "bias" not in self:
            return None
        found = self._pixel * self["bias"].astype(np.float64)
        return found if self.in_space else np.pad(found[..., None] * np.eye(2), [(0, 0), (0, 0), (0, 1), (0, 0)])

    @property
    def points_in_region(self) -> int:
        """Number of points of the grid in the region at the first step."""
        import numpy as np

        return int(self.summary.get("points") or np.isfinite(self["xy"]).all(axis=-1).sum())

    def with_noise_of(self, other: Points) -> Self:
        """These points with errors for the noise of the others: later photographs measure the noise better."""
        if self.noise_grey == other.noise_grey:
            return self
        share = (other.noise_grey / self.noise_grey) ** 2
        names = [name for name in ("covariance", "covariance_left", "template") if name in self]
        variables = self.product.variables
        scaled = {name: variables[name]._replace(values=share * self[name]) for name in names}
        return type(self)(Product(self.product.kind, {**variables, **scaled}, self.product.attrs))

    def lost_at(self, cut: np.ndarray) -> Self:
        """These points with the status DISCONTINUITY where a jump cuts them (row, col)."""
        import numpy as np

        from dicflow.core.status import Status

        status = _LAYOUTS["status"](np.where(cut, np.uint8(Status.DISCONTINUITY), self["status"]))
        return type(self)(Product(self.product.kind, {**self.product.variables, "status": status}, self.product.attrs))

    def measured(self) -> MeasuredPoints:
        """Places and their errors; of one camera, in the plane of its photograph or specimen at height 0."""
        import numpy as np

        from dicflow.core.tensors import symmetric
        from dicflow.core.uncertainty.covariance import MeasuredPoints

        if self.in_space:
            return MeasuredPoints(self["xyz"], symmetric(self["covariance"]), self["sensitivity"])
        return MeasuredPoints(
            self._pixel * np.pad(self["xy"], [(0, 0), (0, 0), (0, 1)]),
            self._pixel**2 * np.pad(symmetric(self["covariance"]), [(0, 0), (0, 0), (0, 1), (0, 1)]),
            self._pixel * np.pad(self["gradient"], [(0, 0), (0, 0), (0, 1), (0, 0)]),
        )

    def measured_at_first_step(self) -> MeasuredPoints:
        """Places and errors at the first step; with one camera these places define the points and have no error."""
        found = self.measured()
        if self.in_space:
            return found
        return found._replace(step_covariance=0.0 * found.step_covariance, sensitivity=0.0 * found.sensitivity)

    def measured_by_left(self) -> MeasuredPoints:
        """Places with the errors by the left photographs alone."""
        from dicflow.core.tensors import symmetric
        from dicflow.core.uncertainty.covariance import MeasuredPoints

        return MeasuredPoints(self["xyz"], symmetric(self["covariance_left"]), self["sensitivity"][..., :2])


def _misfit_share(*views: Kind) -> float:
    """Median share (0 to 1) of misfit in the variance of places, of all photographs together; 0 where all are lost."""
    import numpy as np

    misfit, total = (sum(view[name][..., ::2].sum(axis=-1) for view in views) for name in ("misfit", "covariance"))
    known = np.isfinite(misfit) & (total > 0.0)
    return float(np.median(misfit[known] / total[known])) if known.any() else 0.0


def _median_depth(xyz: np.ndarray) -> float | None:
    """Median of the third coordinate of points (row, col, 3) [mm]; None if all are unknown."""
    import numpy as np

    depth = xyz[..., 2]
    depth = depth[np.isfinite(depth)]
    return float(np.median(depth)) if depth.size else None
