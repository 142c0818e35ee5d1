"""What ± means on a page: what the stated uncertainty contains, and what it does not."""

from __future__ import annotations

from collections.abc import Sequence

from dicflow.explorer.manifest import QuantityEntry

__all__ = ["meaning"]

_COMBINED = "± is the standard uncertainty u (coverage factor 1): 68 % of the errors are within u, 95 % within 2u."
_NOISE = "± is the standard deviation σ (coverage factor 1): 68 % of the errors are within σ, 95 % within 2σ."
_KNOWN = "the calibration (its share stands beside it), "
_UNKNOWN = "the calibration (its share is unknown, since the rig came without its covariance), "


def meaning(quantities: Sequence[QuantityEntry], unit: str) -> list[str]:
    """Whole sentences; none where no quantity has an uncertainty.

    unit : of lengths; in px there is no calibration
    """
    parts = {part for quantity in quantities for part in quantity["errors"]}
    if not parts & {"u", "sigma"}:
        return []
    bias = " and the remaining bias" if "u" in parts else " alone"
    calibration = "" if unit != "mm" else _KNOWN if "share" in parts else _UNKNOWN
    definition = _COMBINED if "u" in parts else _NOISE
    excluded = f"{calibration}blur by the strain gauge, vibration or warm air"
    return [definition, f"It contains the noise of the photographs{bias}, not {excluded}."]
