"""Line charts as SVG that stands inside a page, in the colour of its text."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from itertools import compress, cycle
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dicflow.views.lettering import pitch, text_width, widest
from dicflow.views.svg import element, text_element
from dicflow.views.ticks import Ticks, ticks_that_fit

__all__ = ["Curve", "chart_over_steps", "chart_over_values"]

_COLOURS = ("#3b82b5", "#d95f02", "#4d9a3a", "#a05cb0", "#b08d20", "#7a7a7a")
_WIDTH, _PLOT_HEIGHT, _RIGHT = 440, 190, 16
"""Width of the chart, height of the plot inside it, and room at its right [px]."""
_LETTER, _NAME, _LINE = 12, 10, 17
"""Height of the letters of labels and numbers, and of the names of steps; distance of two lines [px]."""
_MOST_NAMES, _LONGEST_NAME = 40, 24
_MOST_MARKS = 200
"""Points of a curve that have marks; more would hide one another, and a page would be long."""
_MARGIN = 0.05

Numbers = NDArray[np.float64]


class Curve(NamedTuple):
    """Points joined by a line, with a mark at each.

    x, y : NaN is a gap
    hollow : which marks are outlines alone
    square : whether marks are squares, larger than the dots of other curves and below them, and the line is dashed
    joined : whether a line joins the points
    titles : of the marks, for who points at them; empty for none
    x_half, y_half : half the lengths of the bars through the marks, (n,); None for none
    marked : whether marks are drawn; of a joined curve of many points none are
    """

    name: str
    x: Numbers
    y: Numbers
    hollow: NDArray[np.bool_]
    square: bool = False
    joined: bool = True
    titles: Sequence[str] = ()
    x_half: Numbers | None = None
    y_half: Numbers | None = None
    marked: bool = True

    @property
    def ends(self) -> tuple[Numbers, Numbers]:
        """Ends of the bars: x (m,) and y (m,), which the chart has room for."""
        x_half, y_half = (0.0 if half is None else np.nan_to_num(half) for half in (self.x_half, self.y_half))
        return np.concatenate([self.x - x_half, self.x + x_half]), np.concatenate([self.y - y_half, self.y + y_half])

    @property
    def has_marks(self) -> bool:
        """Whether marks are drawn."""
        return self.marked and not (self.joined and len(self.x) > _MOST_MARKS)


class _Scale(NamedTuple):
    """What stands along the lower edge of a plot.

    range : values at its ends
    shares, texts : where the texts stand, from 0 at the left to 1 at the right
    names : whether they are names of steps
    upright : whether they are read from below
    """

    range: tuple[float, float]
    shares: Sequence[float]
    texts: Sequence[str]
    label: str
    names: bool = False
    upright: bool = False

    @property
    def room(self) -> float:
        """Height of the texts and the label [px]."""
        return (widest(self.texts, _NAME) + 10 if self.upright else _LINE + 3) + _LINE


class _Plot(NamedTuple):
    """The plot inside a chart.

    left, top, width : of the plot [px]; its height is that of all
    x, y : values at its edges
    """

    left: float
    top: float
    width: float
    x: tuple[float, float]
    y: tuple[float, float]

    @property
    def bottom(self) -> float:
        """Its lower edge [px]."""
        return self.top + _PLOT_HEIGHT

    def place(self, x: Numbers, y: Numbers) -> Numbers:
        """Where points lie in the chart, (n, 2) [px]."""
        across = self.left + self.width * (x - self.x[0]) / (self.x[1] - self.x[0])
        return np.stack([across, self.top + _PLOT_HEIGHT * (self.y[1] - y) / (self.y[1] - self.y[0])], axis=-1)


def chart_over_values(curves: Sequence[Curve], x_label: str, y_label: str) -> str:
    """Curves over a quantity. Both labels have their unit."""
    x_range = _range(np.concatenate([curve.ends[0] for curve in curves]))
    width = 0.8 * _WIDTH
    found = ticks_that_fit(*x_range, lambda share, texts: share * width >= pitch(texts, _LETTER) + _LETTER)
    return _chart(curves, _Scale(x_range, found.shares, found.texts, f"{x_label} {found.factor}".rstrip()), y_label)


def chart_over_steps(steps: Sequence[str], series: Mapping[str, Sequence[float | None]], y_label: str) -> str:
    """A number at each step, one curve per series; None is a gap."""
    count = len(steps)
    places, filled = np.arange(count, dtype=float), np.zeros(count, bool)
    curves = [Curve(name, places, _numbers(row), filled) for name, row in series.items()]
    stride = max(1, -(-count // _MOST_NAMES))
    names = [_short(name) for name in steps[::stride]]
    upright = pitch(names, _NAME) * len(names) > 0.8 * _WIDTH
    shares = [(place + 0.6) / (count + 0.2) for place in range(0, count, stride)]
    return _chart(curves, _Scale((-0.6, count - 0.4), shares, names, "step", True, upright), y_label)


def _chart(curves: Sequence[Curve], scale: _Scale, y_label: str) -> str:
    y_range = _range(np.concatenate([curve.ends[1] for curve in curves]))
    numbers = ticks_that_fit(*y_range, lambda share, _texts: share * _PLOT_HEIGHT >= 2 * _LETTER)
    left = max(_LINE + 12 + widest(numbers.texts, _LETTER), 10 + text_width(numbers.factor, _LETTER))
    keys = _key_places([curve.name for curve in curves], left) if len(curves) > 1 else []
    above = keys[-1][1] if keys else 0.6 * _LETTER * bool(numbers.factor)
    plot = _Plot(left, _LINE + above, _WIDTH - left - _RIGHT, scale.range, y_range)
    coloured = list(zip(curves, cycle(_COLOURS), strict=False))
    parts = [
        *_beside(plot, numbers, y_label),
        *_below(plot, scale),
        *(_line(plot, curve, colour) for curve, colour in coloured if curve.joined),
        *(_bars(plot, curve, colour) for curve, colour in coloured),
        *(_marks(plot, curve, colour) for curve, colour in sorted(coloured, key=lambda pair: not pair[0].square)),
        *(_key(x, y, curve, colour) for (x, y), (curve, colour) in zip(keys, coloured, strict=False)),
    ]
    height = plot.bottom + scale.room + 4
    return (
        f'<svg class="chart" role="img" viewBox="0 0 {_WIDTH} {height:.0f}" width="{_WIDTH}"'
        f' font-family="sans-serif" font-size="{_LETTER}" fill="currentColor" text-anchor="middle">'
        f"{''.join(parts)}</svg>"
    )


def _beside(plot: _Plot, numbers: Ticks, label: str) -> Iterator[str]:
    """Axes of a plot; light lines across it, their numbers, and the label."""
    for share, text in zip(numbers.shares, numbers.texts, strict=True):
        y = plot.bottom - share * _PLOT_HEIGHT
        yield _light(f"M{plot.left:.1f} {y:.1f}h{plot.width:.1f}")
        yield text_element(plot.left - 7, y + 0.35 * _LETTER, text, "end")
    yield text_element(plot.left - 7, plot.top - 0.9 * _LETTER, numbers.factor, "end")  # above a number at the top
    yield text_element(_LINE - 3, plot.top + _PLOT_HEIGHT / 2, label, upwards=True)
    axes = f"M{plot.left:.1f} {plot.top:.1f}V{plot.bottom:.1f}h{plot.width:.1f}"
    yield element("path", d=axes, fill="none", stroke="currentColor")


def _below(plot: _Plot, scale: _Scale) -> Iterator[str]:
    """Light lines up the plot, and numbers or names and the label below it."""
    for share, text in zip(scale.shares, scale.texts, strict=True):
        x = plot.left + share * plot.width
        yield _light(f"M{x:.1f} {plot.top:.1f}V{plot.bottom:.1f}")
        yield element("path", d=f"M{x:.1f} {plot.bottom:.1f}v4", stroke="currentColor")
        if scale.upright:
            written = text_element(x + 0.35 * _NAME, plot.bottom + 8, text, "end", upwards=True)
        else:
            written = text_element(x, plot.bottom + _LINE, text)
        yield element("g", written, font_size=_NAME) if scale.names else written
    yield text_element(plot.left + plot.width / 2, plot.bottom + scale.room - 4, scale.label)


def _light(path: str) -> str:
    return element("path", d=path, stroke="#8884", stroke_width="0.7")


def _key_places(names: Sequence[str], left: float) -> list[tuple[float, float]]:
    """Where the key of each curve stands, in rows above the plot."""
    x, y, found = left, 15.0, []
    for name in names:
        width = 34 + text_width(name, _LETTER)
        if x > left and x + width > _WIDTH:
            x, y = left, y + _LINE
        found.append((x, y))
        x += width
    return found


def _key(x: float, y: float, curve: Curve, colour: str) -> str:
    """What a curve is drawn with, its line or its mark or both, and its name."""
    line = element("path", d=f"M{x:.1f} {y - 4:.1f}h16", stroke=colour, stroke_width=2, **_dashes(curve))
    mark = _mark(x + 8, y - 4, curve.square, colour, bool(curve.hollow.size and curve.hollow.all()), "")
    drawn = line * curve.joined + mark * curve.has_marks
    return element("g", drawn + text_element(x + 20, y, curve.name, "start"), font_size=_LETTER)


def _dashes(curve: Curve) -> dict[str, str]:
    return {"stroke_dasharray": "5 4"} if curve.square else {}


def _line(plot: _Plot, curve: Curve, colour: str) -> str:
    """The line through the points of a curve, with its gaps."""
    known = np.isfinite(curve.x) & np.isfinite(curve.y)
    path = "".join(
        f"{'L' if number and known[number - 1] else 'M'}{x:.1f} {y:.1f}"
        for number, (x, y) in enumerate(plot.place(curve.x, curve.y).tolist())
        if known[number]
    )
    style = {"stroke": colour, "stroke_opacity": "0.7", "stroke_width": "1.3", **_dashes(curve)}
    return element("path", d=path, fill="none", **style)


def _bars(plot: _Plot, curve: Curve, colour: str) -> str:
    """The bars through the marks of a curve along both axes; none if it has no lengths for them."""
    x, y = curve.x, curve.y
    path = ""
    for half, shift in ((curve.x_half, (1.0, 0.0)), (curve.y_half, (0.0, 1.0))):
        if half is not None:
            first, second = (plot.place(x + sign * shift[0] * half, y + sign * shift[1] * half) for sign in (-1, 1))
            known = np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1) & (half > 0.0)
            ends = zip(first[known].tolist(), second[known].tolist(), strict=True)
            path += "".join(f"M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}" for (a, b), (c, d) in ends)
    return element("path", d=path, fill="none", stroke=colour, stroke_opacity="0.6") if path else ""


def _marks(plot: _Plot, curve: Curve, colour: str) -> str:
    if not curve.has_marks:
        return ""
    known = np.isfinite(curve.x) & np.isfinite(curve.y)
    places = plot.place(curve.x, curve.y)[known].tolist()
    hollow = curve.hollow[known].tolist()
    titles = list(compress(curve.titles, known)) if curve.titles else [""] * len(places)
    marks = zip(places, hollow, titles, strict=True)
    return "".join(_mark(x, y, curve.square, colour, one, title) for (x, y), one, title in marks)


def _mark(x: float, y: float, square: bool, colour: str, hollow: bool, title: str) -> str:
    style = {"fill": "none" if hollow else colour, "stroke": colour}
    inside = element("title", escape(title)) if title else ""
    if square:
        return element("rect", inside, x=x - 4, y=y - 4, width=8, height=8, **style)
    return element("circle", inside, cx=x, cy=y, r=3.5 if title else 2.5, **style)


def _range(values: Numbers) -> tuple[float, float]:
    """A little more than from the least to the largest of some values; NaN does not count."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    margin = _MARGIN * (high - low) or _MARGIN * abs(low) or 1.0
    return low - margin, high + margin


def _numbers(row: Sequence[float | None]) -> Numbers:
    return np.array([math.nan if value is None else value for value in row], dtype=float)


def _short(name: str) -> str:
    half = (_LONGEST_NAME - 1) // 2
    return name if len(name) <= _LONGEST_NAME else f"{name[:half]}…{name[-half:]}"
