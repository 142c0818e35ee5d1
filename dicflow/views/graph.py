"""The stages of a pipeline and what flows between them, as text and as SVG."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import NamedTuple

from dicflow.engine.graph import Graph

__all__ = ["Mark", "graph_svg", "graph_text"]

_WIDTH, _HEIGHT, _GAP_X, _GAP_Y, _MARGIN = 200, 46, 30, 26, 20


class Mark(NamedTuple):
    """Status of a stage in a run.

    status : the class of its box, for a style sheet: hit, computed, failed, skipped or missing
    note : shown in the box beside the number of its tasks
    """

    status: str
    note: str


class _Box(NamedTuple):
    x: float
    y: float


def graph_text(graph: Graph) -> str:
    """One line per stage, each below those it takes from."""
    width = max(len(name) for name in graph.stages)
    lines = []
    for name in _ordered(graph):
        inputs = ", ".join(f"{port} ← {producer}" for port, producer in graph.stages[name].inputs.items())
        lines.append(
            f"{name:<{width}}  {_count(graph, name):<10} {graph.stages[name].node.title}"
            + (f"   [{inputs}]" if inputs else "")
        )
    return "\n".join(lines)


def graph_svg(graph: Graph, marks: Mapping[str, Mark] | None = None) -> str:
    """Rows of boxes from top to bottom, an arrow for every input; no scripts, no links.

    marks : status of each stage; empty for a graph that is only planned
    Colours are attributes, so that a style sheet around the drawing may change them by the classes of the boxes.
    """
    boxes = _layout(graph)
    width = max(box.x for box in boxes.values()) + _WIDTH + _bulge(_MARGIN, boxes) + _MARGIN
    height = max(box.y for box in boxes.values()) + _HEIGHT + _MARGIN
    arrows = [
        _arrow(boxes[producer], boxes[name], port)
        for name, spec in graph.stages.items()
        for port, producer in spec.inputs.items()
        if producer != name
    ]
    drawn = [_drawn(graph, name, box, (marks or {}).get(name)) for name, box in boxes.items()]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" font-family="sans-serif">\n'
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path class="arrow-tip" d="M0 0L8 4L0 8z" fill="#777"/></marker></defs>\n'
        f'<rect class="ground" width="100%" height="100%" fill="white"/>\n{"".join(arrows)}{"".join(drawn)}</svg>\n'
    )


def _ordered(graph: Graph) -> list[str]:
    return sorted(graph.stages, key=lambda name: (_depths(graph)[name], list(graph.stages).index(name)))


def _depths(graph: Graph) -> dict[str, int]:
    """Length of the longest way from a source to each stage."""
    depths: dict[str, int] = {}

    def depth(name: str) -> int:
        if name not in depths:
            producers = [producer for producer in graph.stages[name].inputs.values() if producer != name]
            depths[name] = 1 + max((depth(producer) for producer in producers), default=-1)
        return depths[name]

    for name in graph.stages:
        depth(name)
    return depths


def _layout(graph: Graph) -> dict[str, _Box]:
    """One row per depth; within a row in the order of the producers' places, so that few arrows cross."""
    depths = _depths(graph)
    boxes: dict[str, _Box] = {}
    for row in range(max(depths.values()) + 1):
        names = [name for name in graph.stages if depths[name] == row]
        names.sort(key=lambda name: _mean([boxes[p].x for p in graph.stages[name].inputs.values() if p in boxes]))
        for column, name in enumerate(names):
            boxes[name] = _Box(_MARGIN + column * (_WIDTH + _GAP_X), _MARGIN + row * (_HEIGHT + _GAP_Y))
    return boxes


def _mean(values: list[float]) -> float:
    return sum(values) / len(values) if values else 0.0


def _bulge(start: float, boxes: dict[str, _Box]) -> float:
    """Room for the widest arrow that passes rows by."""
    return start + 0.2 * max(box.y for box in boxes.values())


def _arrow(start: _Box, end: _Box, port: str) -> str:
    """To the next row straight down; past other rows around their right side, the further the longer."""
    if end.y - start.y <= _HEIGHT + _GAP_Y:
        x0, y0, x1, y1 = start.x + _WIDTH / 2, start.y + _HEIGHT, end.x + _WIDTH / 2, end.y
        path = f"M{x0:.1f} {y0:.1f}C{x0:.1f} {y0 + _GAP_Y / 2:.1f} {x1:.1f} {y1 - _GAP_Y / 2:.1f} {x1:.1f} {y1:.1f}"
    else:
        x0, y0, x1, y1 = start.x + _WIDTH, start.y + _HEIGHT / 2, end.x + _WIDTH, end.y + _HEIGHT / 2
        out = max(x0, x1) + _MARGIN + 0.2 * (y1 - y0)
        path = f"M{x0:.1f} {y0:.1f}C{out:.1f} {y0:.1f} {out:.1f} {y1:.1f} {x1:.1f} {y1:.1f}"
    return (
        f'<path class="arrow" d="{path}" fill="none" stroke="#888" marker-end="url(#tip)">'
        f"<title>{escape(port)}</title></path>\n"
    )


def _drawn(graph: Graph, name: str, box: _Box, mark: Mark | None) -> str:
    centre, title = box.x + _WIDTH / 2, graph.stages[name].node.title
    status, note = mark if mark is not None else ("planned", "")
    below = " · ".join(part for part in (_count(graph, name), note or title) if part)
    return (
        f'<g class="stage {escape(status)}"><title>{escape(title)}</title>'
        f'<rect x="{box.x:.1f}" y="{box.y:.1f}" width="{_WIDTH}" height="{_HEIGHT}" rx="6" '
        'fill="#eef3f8" stroke="#31688e"/>'
        f'<text x="{centre:.1f}" y="{box.y + 19:.1f}" text-anchor="middle" font-size="13">{escape(name)}</text>'
        f'<text class="note" x="{centre:.1f}" y="{box.y + 36:.1f}" text-anchor="middle" font-size="10" fill="#555">'
        f"{escape(below)}</text></g>\n"
    )


def _count(graph: Graph, name: str) -> str:
    steps = graph.steps[name]
    return f"{len(steps)} ×" if steps else "once"
