"""Types of parameters that several stages share."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from dicflow.engine.node import Pixels

__all__ = ["WindowSide"]

WindowSide = Annotated[Pixels, Field(gt=0)]
"""One side of a window."""
