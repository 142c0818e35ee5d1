"""Whether the rig of a result is still calibrated, by the points that the photographs of the first step show."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dicflow.kinds.correlation import Correlation
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.stereo import Stereo
from dicflow.pipeline.result import Result

if TYPE_CHECKING:
    from dicflow.core.cameras.relative_orientation import MatchedPoints
    from dicflow.core.cameras.rig_check import RigCheck

__all__ = ["rig_answer", "rig_sources"]

_MOST_POINTS = 2000


def rig_answer(result: Result, variant: int = 0) -> RigCheck | None:
    """The check of the rig with which points were matched; None where no such points are stored."""
    from dicflow.core.cameras.rig_check import check_rig

    stored = _stored(result, variant)
    if not stored:
        return None
    right, left, rig = (result.product(stage, step, variant) for stage, step in stored)
    calibrated = CalibratedRig.read(rig)
    return check_rig(calibrated.cameras, calibrated.covariance, _matched(Correlation.read(left), Stereo.read(right)))


def rig_sources(result: Result, variant: int = 0) -> list[str]:
    """Digests of the products on which :func:`rig_answer` rests; empty without any."""
    return [result.digest(stage, step, variant) for stage, step in _stored(result, variant)]


def _stored(result: Result, variant: int) -> list[tuple[str, int | None]]:
    """Stages and steps of the matched points, those of the left photograph, and the rig; empty if one is not there."""
    for stage in result.stages_of("stereo"):
        sources = {port: result.source(stage, port, variant) for port in ("rig", "correlation")}
        stored: list[tuple[str, int | None]] = [(stage, 0), (sources["correlation"], 0), (sources["rig"], None)]
        if all(result.has(one, step, variant) for one, step in stored):
            return stored
    return []


def _matched(left: Correlation, right: Stereo) -> MatchedPoints:
    """Points of both photographs, so far apart that their subsets share no pixel."""
    import numpy as np

    from dicflow.core.cameras.relative_orientation import MatchedPoints

    apart = max(1, round(left.grid.subset_size / left.grid.step_size))
    thin = (slice(None, None, apart),) * 2
    parts = left["xy"], right["xy"], left["template"], right["covariance"]
    flat = [part[thin].astype(float).reshape(-1, part.shape[-1]) for part in parts]
    known = np.flatnonzero(np.isfinite(np.concatenate(flat, axis=-1)).all(axis=-1))
    known = known[:: max(1, -(-len(known) // _MOST_POINTS))]
    return MatchedPoints(*(part[known] for part in flat))
