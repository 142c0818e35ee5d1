"""Whether lenses have distortion that the lens model of a calibration leaves out."""

from __future__ import annotations

from typing import Literal

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.calibration.bundle import Bundle, LensModel, adjust, residual_lengths, residuals
from dicflow.core.calibration.robust import Loss, cost

__all__ = ["DistortionTerm", "unmodelled_distortion"]

DistortionTerm = Literal["tangential", "third radial"]

_MIN_COST_GAIN = 0.03
_NEGLIGIBLE_RMS_PX = 2e-4


def unmodelled_distortion(
    bundle: Bundle, board: Array, left: Array, right: Array, model: LensModel, loss: Loss
) -> tuple[DistortionTerm, ...]:
    """Terms left out of the lens model that would lower the residuals' cost by 3 % or more.

    If the residuals are noise alone, four or two more coefficients lower the cost by that share only where there are
    fewer than about a hundred residuals.

    bundle : adjusted with the model; board : (m, 3) [mm]; left, right : (n, m, 2) [px], as in
        :func:`~dicflow.core.calibration.bundle.residuals`
    """
    richer: dict[DistortionTerm, LensModel] = {}
    if not model.tangential:
        richer["tangential"] = model._replace(tangential=True)
    if model.radial < 3:
        richer["third radial"] = model._replace(radial=3)
    seen = (board, left, right)
    before = residual_lengths(residuals(bundle, *seen))
    if np.sqrt(np.mean(before**2)) < _NEGLIGIBLE_RMS_PX:
        return ()
    after = {
        name: residual_lengths(residuals(adjust(bundle, *seen, more, loss), *seen)) for name, more in richer.items()
    }
    return tuple(name for name, rest in after.items() if cost(loss, rest) < (1.0 - _MIN_COST_GAIN) * cost(loss, before))
