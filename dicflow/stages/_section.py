"""The section of a specimen as settings give it."""

from __future__ import annotations

__all__ = ["check_uncertainty"]

_LARGEST = 0.5
"""Standard uncertainty of a length, relative to it, from which its unit is taken to be forgotten."""


def check_uncertainty(name: str, value: float | None, u: float | None) -> None:
    """Raise ValueError for an uncertainty of a length, both in mm, that is about as large as it."""
    if value is not None and u is not None and u >= _LARGEST * value:
        raise ValueError(
            f"u_{name} is {u:g} mm for a {name} of {value:g} mm; write the unit, such as 5 um, if it is another"
        )
