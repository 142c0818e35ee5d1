"""The frame in which results are given."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from dicflow.engine.node import At, Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.frame import ResultFrame
from dicflow.kinds.points import Points

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.frames import Frame as Axes

__all__ = ["Frame", "sentence"]

Place = Annotated[tuple[float, ...], Field(min_length=2, max_length=3)]
Vector = tuple[float, float, float]


class Frame(Node):
    """Choose the axes of the results from the points of the first step.

    ``plane``: the specimen's best plane, X along the camera's X, Y down, Z away from the camera, its origin the mean of
    the points. ``three_points``: the first is the origin, X runs to the second, Y lies on the side of the third; each
    is given as [x, y] in px of the left photograph, or as [X, Y, Z] in mm of the left camera's frame. ``axes``:
    directions x and y in that frame, y made perpendicular to x, and an origin. ``camera``: the left camera's own.
    """

    title: ClassVar = "frame of the results"
    scope: ClassVar = Scope.TEST
    takes: ClassVar = {"points": Port("points", at=At.FIRST)}
    gives: ClassVar = "frame"

    stage: Literal["frame"] = "frame"
    method: Literal["plane", "three_points", "axes", "camera"] = parameter("plane", "what determines the axes")
    places: Annotated[tuple[Place, ...], Field(min_length=3, max_length=3)] | None = parameter(
        None, "three_points: origin, a point on X, a point on the side of Y; [x, y] in px or [X, Y, Z] in mm"
    )
    x: Vector | None = parameter(None, "axes: direction of X in the left camera's frame")
    y: Vector | None = parameter(None, "axes: direction on the side of Y")
    origin: Vector | None = parameter(None, "axes: the origin in the left camera's frame", unit="mm")

    @model_validator(mode="after")
    def _complete(self) -> Self:
        needs = {"three_points": ("places",), "axes": ("x", "y", "origin")}.get(self.method, ())
        given = [name for name in ("places", "x", "y", "origin") if getattr(self, name) is not None]
        if set(given) != set(needs):
            needed, found = (", ".join(names) or "nothing" for names in (needs, given))
            raise ValueError(f"method: {self.method} needs {needed} beside it, found {found}")
        return self

    def run(self, points: Product) -> Product:
        import numpy as np

        from dicflow.core.cameras.frames import into_frame

        measured = Points.read(points)
        try:
            axes = self._axes(measured)
        except ValueError as error:
            raise StageError(f"{error}; look at the points of the first step, or choose another method") from error
        height = into_frame(measured["xyz"], axes)[..., 2]
        height = height[np.isfinite(height)]
        summary = {"flatness_mm": float(np.sqrt(np.mean(height**2)))} if height.size else {}
        return ResultFrame.write(axes, self.method, summary)

    def _axes(self, points: Points) -> Axes:
        from dicflow.core.cameras.frames import LEFT_CAMERA, axes_frame, plane_frame, three_point_frame

        if self.method == "plane":
            return plane_frame(points["xyz"])
        if self.method == "three_points" and self.places is not None:
            return three_point_frame(*(_in_space(points, place) for place in self.places))
        if self.x is not None and self.y is not None and self.origin is not None:
            return axes_frame(self.x, self.y, self.origin)
        return LEFT_CAMERA


def _in_space(points: Points, place: tuple[float, ...]) -> np.ndarray:
    """A place in space [mm], or in the photograph [px] as the surface shows it."""
    import numpy as np

    from dicflow.core.probes.weights import point_probe, value_of

    if len(place) == 3:
        return np.array(place)
    known = np.isfinite(points["xyz"]).all(axis=-1)
    probe = point_probe(points["xy"], known, place, float(points.grid.step_size))
    if probe is None:
        raise StageError(f"the first step has no measured point at {list(place)} px; choose a place in the region")
    return value_of(probe, points["xyz"])


def sentence(stage: Frame, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    axes = {
        "plane": "X and Y lie in the best plane of the specimen at the first step",
        "three_points": "X and Y run through three chosen points of the specimen",
        "axes": "X and Y have chosen directions",
        "camera": "the axes are those of the left camera",
    }
    return f"In the coordinate system of the results {axes[stage.method]}."
