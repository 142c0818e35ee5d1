"""Points of one camera in millimetres, and what the scale's uncertainty adds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.points import Points
from dicflow.kinds.quantities import Quantity
from dicflow.kinds.scale import Scale

if TYPE_CHECKING:
    import numpy as np

__all__ = ["in_unit", "scale_shares"]


def in_unit(points: Points, scale: Product | None) -> Points:
    """The points, in millimetres with a scale. Raises StageError for a scale of points in space."""
    if scale is None:
        return points
    if points.in_space:
        raise StageError(
            "a scale is for one camera, but two measured these points in mm; remove the stage of the scale"
        )
    return points.in_mm(Scale.read(scale).mm_per_px)


def scale_shares(
    relative: float, quantities: Mapping[str, Quantity], fields: Mapping[str, np.ndarray], xyz: np.ndarray
) -> dict[str, np.ndarray]:
    """The share of one camera's scale in σ: of places and displacements in proportion to them, of strains none.

    relative : standard uncertainty of the scale over the scale
    xyz : (row, col, 3) — places at the step [mm]
    """
    import numpy as np

    calibrated = {name: one for name, one in quantities.items() if one.calibrated and name in fields}
    shares = {name: relative if one.is_displacement else 0.0 for name, one in calibrated.items()}
    found = {f"calibration_{name}": share * np.abs(fields[name]) for name, share in shares.items()}
    return {"calibration_xyz": relative * np.abs(xyz), **found}
