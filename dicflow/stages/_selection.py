"""Which photographs of a series are measured, as people write it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict

from dicflow.engine.node import Pixels, parameter
from dicflow.engine.units import quantity

if TYPE_CHECKING:
    from dicflow.io.images import Selection

__all__ = ["MOVED_PX", "Place", "Select"]

MOVED_PX = 1.0
"""Motion that makes a step where nobody says how much [px]."""

Place = int | Annotated[float, BeforeValidator(quantity("s"))]
"""A step by its number from 1, or by the time since the first one: ``"12.5 s"``."""


class Select(BaseModel):
    """Which steps of a series are measured; each condition holds among the steps that those above it leave."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, populate_by_name=True)

    at: list[Place] | None = parameter(None, "these steps alone, by number or time", affects="speed", min_length=1)
    from_: Place | None = parameter(None, "the first step, by number or time", affects="speed", alias="from")
    to: Place | None = parameter(None, "the last step, by number or time", affects="speed")
    without: list[str | int] = parameter(
        [], "not these steps, by name or number, such as one whose frame cannot be decoded", affects="speed"
    )
    every: int = parameter(1, "one step of so many", affects="speed", ge=1)
    moved: Pixels | None = parameter(
        None,
        "a step whenever a part of the picture has moved by so much since the one before: rests are thinned out",
        unit="px",
        affects="speed",
        gt=0,
    )
    sharpest: int | None = parameter(
        None,
        "so many steps at most, sharp ones that differ most from one another: boards in a video",
        affects="speed",
        ge=1,
    )

    def selection(self) -> Selection:
        """The same for :mod:`dicflow.io.images.selection`."""
        from dicflow.io.images import Selection

        places = self.at or (), self.from_, self.to, self.without
        return Selection(*places, self.every, self.moved, self.sharpest)
