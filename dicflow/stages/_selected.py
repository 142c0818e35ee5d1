"""A region that a user has drawn, before it is carried into the image that is measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.photographs.polygon import Polygon

__all__ = ["Selected"]


class Selected(NamedTuple):
    """A region in the pixels of an image: ``name`` in messages, ``size`` (width, height), lines to cut along [px]."""

    polygons: Sequence[Polygon]
    size: tuple[int, int]
    name: str
    cuts: Sequence[np.ndarray] = ()
