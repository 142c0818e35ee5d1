"""Whether lenses show distortion that the model of a calibration leaves out."""

from __future__ import annotations

from typing import Literal

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.calibration.bundle import Bundle, Model, adjust, lengths, residuals
from dicflow.core.calibration.robust import Loss, cost

__all__ = ["Distortion", "left_out"]

Distortion = Literal["tangential", "third radial"]

_GAIN = 0.03
_NOTHING_TO_GAIN_PX = 2e-4


def left_out(
    bundle: Bundle, board: Array, left: Array, right: Array, model: Model, loss: Loss
) -> tuple[Distortion, ...]:
    """Which coefficients that are not estimated would explain 3 % of the residuals' cost or more.

    Of residuals that are noise alone, four or two more coefficients explain that share only where there are fewer than
    about a hundred.

    board : (m, 3) [mm]; left, right : (n, m, 2) [px], as in
        :func:`~dicflow.core.calibration.bundle.residuals`; the bundle adjusted
    """
    richer: dict[Distortion, Model] = {}
    if not model.tangential:
        richer["tangential"] = model._replace(tangential=True)
    if model.radial < 3:
        richer["third radial"] = model._replace(radial=3)
    seen = (board, left, right)
    before = lengths(residuals(bundle, *seen))
    if np.sqrt(np.mean(before**2)) < _NOTHING_TO_GAIN_PX:
        return ()
    after = {name: lengths(residuals(adjust(bundle, *seen, more, loss), *seen)) for name, more in richer.items()}
    return tuple(name for name, rest in after.items() if cost(loss, rest) < (1.0 - _GAIN) * cost(loss, before))
