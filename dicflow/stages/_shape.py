"""The shape function that the subsets of a step need, and what it leaves out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.correlation.points import FoundPoints
    from dicflow.core.parts import Parts
    from dicflow.core.surfaces.shape_bias import PlacesOfSubsets
    from dicflow.stages._subsets import ShapeFunction

__all__ = ["left_out", "needed_shape"]


def needed_shape(
    found: FoundPoints, used: str, grid_px: tuple[int, int], parts: Parts, threads: int
) -> tuple[ShapeFunction, np.ndarray | None]:
    """The shape function that points need, found with subsets of one; and what it leaves out, if that is known by then.

    grid_px : side of the subsets, distance of the points
    """
    from dicflow.core.surfaces.shape_bias import affine_suffices, as_of_affine, shape_bias

    places = _places(found) if used == "affine" else as_of_affine(_places(found), *grid_px)
    bias = shape_bias(places, *grid_px, "affine", parts, _jumps(found), threads)
    if not affine_suffices(bias, places.variance):
        return "quadratic", None
    return "affine", bias.deviation if used == "affine" else None


def left_out(
    found: FoundPoints, shape_function: Any, grid_px: tuple[int, int], parts: Parts, threads: int
) -> np.ndarray:
    """What a shape function leaves out of the places, as a standard deviation (row, col, 2) [px]."""
    from dicflow.core.surfaces.shape_bias import shape_bias

    return shape_bias(_places(found), *grid_px, shape_function, parts, _jumps(found), threads).deviation


def _places(found: FoundPoints) -> PlacesOfSubsets:
    from dicflow.core.surfaces.shape_bias import PlacesOfSubsets

    return PlacesOfSubsets(found.warp[..., 0], (found.covariance + found.template_covariance)[..., ::2])


def _jumps(found: FoundPoints) -> np.ndarray:
    """Points (row, col) beside which the motion may jump."""
    import numpy as np

    from dicflow.core.status import Status

    return np.asarray(np.isin(found.status, (Status.DISCONTINUITY, Status.MISFIT, Status.OUTLIER)))
