"""What is said of probes that lie where nothing is measured."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from dicflow.kinds.probes import Reading

__all__ = ["extent_text", "has_value", "missing_facts", "probes_text"]


def has_value(readings: Mapping[str, Reading]) -> bool:
    """Whether anything that a probe reads is known."""
    return any(math.isfinite(reading.value) for reading in readings.values())


def probes_text(names: Sequence[str]) -> str:
    """Probes as the subject of a sentence about each."""
    listed = ", ".join(f"'{name}'" for name in names)
    return f"probe {listed}" if len(names) == 1 else f"each of the probes {listed}"


def extent_text(extents: Sequence[list[float]], unit: str) -> str:
    """Where a probe may lie.

    extents : of the points measured at each step, least x and y, largest x and y [unit]; empty without any
    """
    known = [extent for extent in extents if extent]
    if not known:
        return "no step has one anywhere; look at the correlation"
    least, most = ([choose(column) for column in zip(*known, strict=True)] for choose in (min, max))
    x, y = f"x {least[0]:.4g} … {most[2]:.4g}", f"y {least[1]:.4g} … {most[3]:.4g}"
    return f"move it into the region: points are measured at {x}, {y} {unit} of the first step"


def missing_facts(missing: Mapping[str, str]) -> dict[str, Any]:
    """Attributes for the probes without a value, if there are any: why, and the warning of it."""
    sentences = [f"{probes_text(list(missing))} {reason}" for reason in set(missing.values())]
    return {"unmeasured": dict(missing), "warnings": sentences} if missing else {}
