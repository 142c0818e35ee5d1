"""Errors of the points of two steps, as the deformation between them inherits them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dicflow.kinds.points import Points

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.frames import Frame
    from dicflow.core.strain.deformation_gradient import ErrorShare
    from dicflow.core.strain.point_scatter import AxisScatter
    from dicflow.core.strain.unseen_jumps import UnseenJumps
    from dicflow.core.uncertainty.overlap import ShapeFunction
    from dicflow.kinds.correlation import SubsetGrid

__all__ = ["bias_of_displacements", "bias_of_places", "errors_as_seen", "errors_by_shape", "variance_shares"]


def errors_by_shape(
    covariance: np.ndarray, step: Points, first: Points, frames: tuple[Frame, Frame]
) -> dict[ShapeFunction, ErrorShare]:
    """The covariance of the points at both steps by the shape function of the subsets that cause it.

    frames : that of the results, and the one that moves with the removed motion
    """
    from dicflow.core.strain.deformation_gradient import ErrorShare
    from dicflow.core.uncertainty.covariance import joint_covariance, points_in_frame
    from dicflow.core.uncertainty.overlap import overlap

    grid = (first.grid.subset_size, first.grid.step_size)
    own: Any = step.left_shape_function
    other: Any = step.grid.shape_function
    if own == other:
        return {own: ErrorShare(covariance, overlap(*grid, own))}
    after, before = (points_in_frame(points.measured_by_left(), frames[0]) for points in (step, first))
    left = joint_covariance(points_in_frame(after, frames[1]), before, step.template[..., :2, :2])
    return {own: ErrorShare(left, overlap(*grid, own)), other: ErrorShare(covariance - left, overlap(*grid, other))}


def variance_shares(errors: Mapping[ShapeFunction, ErrorShare]) -> dict[str, list[float]]:
    """Shares of each shape function in the variance of U, V and W, means over the points."""
    import numpy as np

    from dicflow.core.uncertainty.covariance import displacement_variances

    if len(errors) == 1:
        return {name: [1.0, 1.0, 1.0] for name in errors}
    variances = np.stack([displacement_variances(part.covariance) for part in errors.values()])
    known = (variances.sum(axis=0) > 0.0).all(axis=-1)
    shares = variances[:, known] / variances[:, known].sum(axis=0)
    means = shares.mean(axis=1) if known.any() else np.full((len(errors), 3), 1.0 / len(errors))
    return {name: part.tolist() for name, part in zip(errors, means, strict=True)}


def errors_as_seen(
    covariance: np.ndarray, errors: Mapping[ShapeFunction, ErrorShare], seen: Sequence[AxisScatter], grid: SubsetGrid
) -> tuple[np.ndarray, dict[ShapeFunction, ErrorShare]]:
    """The covariance of the points at both steps as noise, and its shares with all that is seen along each axis."""
    size = (grid.subset_size, grid.step_size)
    scale = _products([axis.variance for axis in seen])
    scaled = {
        shape: one._replace(
            covariance=scale * one.covariance, along=tuple(axis.correlation(*size, shape) for axis in seen)
        )
        for shape, one in errors.items()
    }
    return _products([axis.noise for axis in seen]) * covariance, scaled


def _products(variances: Sequence[np.ndarray]) -> np.ndarray:
    """Products (row, col, 6, 6) of the standard deviations of both steps from variances (row, col) along each axis."""
    import numpy as np

    deviations = np.sqrt(np.stack([*variances, *variances], axis=-1))
    return np.asarray(deviations[..., :, None] * deviations[..., None, :])


def bias_of_places(step: Points, turn: np.ndarray) -> np.ndarray | None:
    """Remaining bias (row, col, 3) of U, V and W by the shape functions; None if unknown.

    turn : into the frame of the result
    """
    import numpy as np

    return None if step.bias is None else np.linalg.norm(turn @ step.bias, axis=-1)


def bias_of_displacements(places: np.ndarray | None, jumps: UnseenJumps | None) -> dict[str, np.ndarray]:
    """Remaining bias of U, V and W, with that by jumps; empty if that by the shape functions is unknown.

    places : (row, col, 3) — by the shape functions
    """
    import numpy as np

    if places is None:
        return {}
    if jumps is not None:
        between = jumps.of_places()
        places = np.where(between > 0.0, np.hypot(np.nan_to_num(places), between), places)
    return {f"bias_{name}": places[..., axis] for axis, name in enumerate("UVW")}
