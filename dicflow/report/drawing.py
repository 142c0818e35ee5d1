"""Line drawings to scale, with units on the axes, for the templates of a page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Drawing", "Shape", "drawing", "ticks"]

_WIDTH, _HEIGHT = 300.0, 300.0
_LEFT, _BOTTOM, _TOP, _RIGHT = 52.0, 40.0, 12.0, 16.0


class Shape(NamedTuple):
    """A closed outline or single points.

    kind : CSS class
    title : shown where a pointer rests on it
    points : (n, 2) in the units of the axes
    closed : whether lines join the points
    """

    kind: str
    title: str
    points: NDArray[np.float64]
    closed: bool = True


class Drawing(NamedTuple):
    """Input of the template, in SVG units.

    size : (width, height) of the whole
    frame : (x, y, width, height) of the field
    x_ticks, y_ticks : places and numbers of the ticks
    labels : of the x and the y axis, with their unit
    shapes : (CSS class, title, path)
    """

    title: str
    size: tuple[float, float]
    frame: tuple[float, float, float, float]
    x_ticks: list[tuple[float, str]]
    y_ticks: list[tuple[float, str]]
    labels: tuple[str, str]
    shapes: list[tuple[str, str, str]]


def drawing(
    title: str,
    labels: tuple[str, str],
    box: tuple[float, float, float, float],
    shapes: Sequence[Shape],
    upwards: bool = False,
) -> Drawing:
    """Shapes to scale, both axes alike.

    box : (x0, y0, x1, y1), the part that is seen
    upwards : whether y runs upwards on the page
    """
    x0, y0, x1, y1 = box
    scale = min(_WIDTH / (x1 - x0), _HEIGHT / (y1 - y0))
    width, height = (x1 - x0) * scale, (y1 - y0) * scale

    def place(points: NDArray[Any]) -> NDArray[np.float64]:
        x, y = (points[:, 0] - x0) * scale, (points[:, 1] - y0) * scale
        return np.stack([_LEFT + x, _TOP + (height - y if upwards else y)], axis=-1)

    return Drawing(
        title,
        (round(_LEFT + width + _RIGHT), round(_TOP + height + _BOTTOM)),
        (_LEFT, _TOP, round(width, 1), round(height, 1)),
        [(float(place(np.array([[value, y0]]))[0, 0]), text) for value, text in ticks(x0, x1, width / 110)],
        [(float(place(np.array([[x0, value]]))[0, 1]), text) for value, text in ticks(y0, y1, height / 80)],
        labels,
        [(shape.kind, shape.title, _path(place(shape.points), shape.closed)) for shape in shapes],
    )


def ticks(low: float, high: float, least: float) -> list[tuple[float, str]]:
    """Round numbers between two values, about so many or up to 2.5 times as many, and their texts; at least two."""
    rough = (high - low) / max(2.0, least)
    power = 10.0 ** math.floor(math.log10(rough) + 1e-9)
    step = max(step * power for step in (1, 2, 5) if step * power <= rough * (1 + 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    places = max(0, -math.floor(math.log10(step) + 1e-9))
    return [(k * step, f"{k * step:.{places}f}".replace("-", "−")) for k in range(first, last + 1)]


def _path(points: NDArray[np.float64], closed: bool) -> str:
    """An outline, or a dot at each point: lines without length, drawn by their round ends."""
    if not closed:
        return "".join(f"M{x:.1f} {y:.1f}h0" for x, y in points)
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points) + "Z"
