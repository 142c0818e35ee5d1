"""Replace a point cloud by smooth surfaces."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

from dicflow.engine.node import Node, Pixels, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.cloud import Cloud

__all__ = ["Surface", "sentence"]

Power = Annotated[int, Field(ge=0, le=5)]


class CoordinateDegrees(BaseModel):
    """Degree in x (column) and y (row) of the polynomial for each coordinate."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    x: tuple[Power, Power] = (3, 3)
    y: tuple[Power, Power] = (3, 3)
    z: tuple[Power, Power] = (2, 2)


class Surface(Node):
    """Fit a smooth surface to each coordinate of the cloud, as a function of the pixel (column, row).

    The surface covers every point of the cloud and a band around them (status FILLED), so that places at the very edge
    can be interpolated; beyond the band values are NaN. ``degree: auto`` selects the degree with the lowest Bayesian
    information criterion, with the number of points whose errors are independent. The product's ``fit`` holds degree,
    the reason for it, SSE, R², adjusted R² and RMSE of each coordinate.
    """

    title: ClassVar = "fit smooth surfaces"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {"cloud": Port("cloud")}
    gives: ClassVar = "cloud"

    stage: Literal["surface"] = "surface"
    method: Literal["polynomial", "lowess"] = parameter(
        "polynomial", "one polynomial for the region, or local regression (slower, for surfaces of any shape)"
    )
    degree: CoordinateDegrees | Literal["auto"] = parameter(
        CoordinateDegrees(), "degree [x, y] of the polynomial for each of x, y and z, or auto"
    )
    robust: Literal["none", "lar", "bisquare"] = parameter("bisquare", "how the weight of outliers is reduced")
    lowess_window: Pixels = parameter(61.0, "side of the window of the local regression", unit="px", ge=5)
    lowess_degree: Literal[1, 2] = parameter(1, "degree of the local regression")
    margin: Pixels = parameter(12.0, "width of the band around the cloud with a value", unit="px", ge=0)
    max_points: int = parameter(
        50_000, "most points from which the weights are found; the last solution uses all points", ge=1000
    )

    def run(self, cloud: Product) -> Product:
        import numpy as np

        from dicflow.core.status import Status
        from dicflow.core.surfaces.filters import within_reach

        before = Cloud.read(cloud)
        xyz = np.asarray(before["xyz"], dtype=np.float64)
        had = np.isfinite(xyz).all(axis=2)
        if not had.any():
            return cloud
        fitted, facts = np.empty_like(xyz), {}
        for index, name in enumerate("xyz"):
            try:
                fitted[..., index], facts[name] = self._fit(xyz[..., index], name)
            except ValueError as error:
                raise StageError(
                    f"coordinate {name}: {error}; lower the degree, or look at the disparity and region of this step"
                ) from error
        has = within_reach(had, self.margin) & np.isfinite(fitted).all(axis=2)
        fitted[~has] = np.nan
        status = np.where(has & ~had, np.uint8(Status.FILLED), before["status"])
        measures = ("sse", "r2", "adjusted_r2", "rmse")
        units = {"sse": "_mm2", "rmse": "_mm"}
        summary = {f"{m}_{name}{units.get(m, '')}": facts[name][m] for name in "xyz" for m in measures}
        return Cloud.write(fitted, status, before.origin, summary, fit=facts, title="smooth surface")

    def _fit(self, values: Any, name: str) -> tuple[Any, dict[str, Any]]:
        """The surface of one coordinate (row, col), and its statistics."""
        if self.method == "lowess":
            return self._lowess(values)
        import numpy as np

        from dicflow.core.surfaces.surface import choose_degree, evaluate, fit_surface

        why = "given"
        if self.degree == "auto":
            choice = choose_degree(values, self.robust, self.max_points)
            degree, why = (choice.degree, choice.degree), choice.reason
        else:
            degree = getattr(self.degree, name)
        surface = fit_surface(values, degree, self.robust, self.max_points)
        facts = {
            "degree": list(degree),
            "why": why,
            "robust": self.robust,
            "converged": surface.converged,
            **surface.quality._asdict(),
        }
        return evaluate(surface, np.arange(values.shape[1]), np.arange(values.shape[0])), facts

    def _lowess(self, values: Any) -> tuple[Any, dict[str, Any]]:
        from dicflow.core.surfaces.filters import odd_window
        from dicflow.core.surfaces.surface import fit_lowess

        window = odd_window((self.lowess_window, self.lowess_window))
        smooth = fit_lowess(values, window, self.lowess_degree, self.robust)
        facts = {"degree": self.lowess_degree, "window_px": list(window), "robust": self.robust}
        return smooth.values, {**facts, **smooth.quality._asdict()}


def sentence(stage: Surface, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    robust = "" if stage.robust == "none" else ", with reduced weights of outliers [holland1977]"
    if stage.method == "lowess":
        return (
            f"The points of each step were smoothed by local regression of degree {stage.lowess_degree} in windows of "
            f"{stage.lowess_window:g} px [cleveland1979]{robust}."
        )
    if stage.degree == "auto":
        degrees = "a degree chosen by the Bayesian information criterion"
    else:
        named = (f"{axis} {p} × {q}" for axis, (p, q) in stage.degree.model_dump().items())
        degrees = f"the degrees {', '.join(named)}"
    return f"The coordinates of the points of each step were fitted by polynomials of {degrees}{robust}."
