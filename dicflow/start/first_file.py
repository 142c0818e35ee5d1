"""The text of a first pipeline file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dicflow.core.calibration.board import Board
from dicflow.engine.units import quantity
from dicflow.errors import ConfigurationError
from dicflow.io.configuration import parse
from dicflow.pipeline.wiring import wire
from dicflow.start.folder import Found
from dicflow.start.photographs import Photographs

__all__ = ["OPEN", "pipeline_text", "with_unit"]

OPEN = "FILL IN the"
"""Marks what the user has to fill in."""

_GAUGE = "along_load"
_WIDTH = 110


def pipeline_text(found: Found, square: str | None, path: Path) -> str:
    """The pipeline file, commented, for one camera or two.

    square : side of a square of the board; None leaves it for the user to fill in
    path : of the file, for messages
    Raises ConfigurationError if the square is not a length, or a name cannot be written.
    """
    wire(parse(_text(found, square or "1 mm"), str(path)))
    return _text(found, square)


def with_unit(square: str) -> str:
    """The side of a square as the user gives it, in mm if it has no unit.

    Raises ConfigurationError if it is not a length.

    >>> with_unit("14.5")
    '14.5 mm'
    """
    text = f"{square} mm" if re.fullmatch(r"\s*[\d.,]+\s*", square) else square
    try:
        quantity("mm")(text)
    except ValueError as error:
        raise ConfigurationError(f"--square: {error}") from error
    return text


def _text(found: Found, square: str | None) -> str:
    lines = [
        "dicflow: 1",
        "stages:",
        "  # photographs of the specimen, in the order of the steps; the first is the reference",
        *_image_lines("photos", found.photos),
    ]
    lines += _stereo_lines(found, square) if found.photos.right else _planar_lines(found)
    return "\n".join([*lines, *_result_lines(found)]) + "\n"


def _quoted(key: str, value: str | Sequence[str]) -> str:
    """A key and its value, quoted so that YAML reads any characters back; JSON's strings are YAML's."""
    single = value[0] if not isinstance(value, str) and len(value) == 1 else value
    return f"{key}: {json.dumps(single, ensure_ascii=False)}"


def _image_lines(name: str, series: Photographs) -> list[str]:
    """A stage of photographs, on one line if it fits; of long lists each file on a line."""
    cameras = {side: patterns for side, patterns in (("left", series.left), ("right", series.right)) if patterns}
    values = [_quoted(side, patterns) for side, patterns in cameras.items()]
    way = [f"{key}: {_flow(value)}" for key, value in series.parameters.items()]
    line = f"  {name}: {{stage: images, {', '.join([*values, *way])}}}"
    if len(line) <= _WIDTH:
        return [line]
    lines = [f"  {name}:", "    stage: images", *(f"    {one}" for one in way)]
    for side, value in zip(cameras, values, strict=True):
        if len(value) <= _WIDTH:
            lines.append(f"    {value}")
        else:
            lines += [f"    {side}:", *(f"      - {json.dumps(one, ensure_ascii=False)}" for one in cameras[side])]
    return lines


def _flow(value: Any) -> str:
    """A value on one line."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key}: {one}' for key, one in value.items())}}}"
    return str(value)


def _stereo_lines(found: Found, square: str | None) -> list[str]:
    return [
        *_rig_lines(found, square),
        "",
        "  # material points followed from step to step in the left photographs, and found in the right ones",
        _region_line(found, "photos"),
        *_correlation_lines("photos"),
        "  stereo: {stage: stereo, images: photos}",
        "  points: {stage: triangulate}",
    ]


def _rig_lines(found: Found, square: str | None) -> list[str]:
    if found.boards is None or found.board is None:
        file = _quoted("file", found.calibration or "")
        return [
            "",
            "  # the rig, from a calibration by another program",
            f"  rig: {{stage: rig_file, images: photos, {file}}}",
        ]
    side = "distance of neighbouring rows of circles" if "circles" in found.board.target else "side of one square"
    return [
        "",
        f"  # the rig, from photographs of {found.board.text}",
        *_image_lines("boards", found.boards),
        f"  corners: {{stage: corners, images: boards, {_board_values(found.board)}}}",
        "  rig:",
        "    stage: calibrate",
        f"    square: {square or f'  # {OPEN} {side} as you measured it, such as 14.5 mm'}",
        "    tangential: true",
    ]


def _board_values(board: Board) -> str:
    """Parameters of the stage that finds a board's corners."""
    values = [f"size: [{board.size[0]}, {board.size[1]}]"]
    if board.target != "checkerboard":
        values.append(f"target: {board.target}")
    if board.dictionary is not None:
        values += [f"dictionary: {board.dictionary}", f"marker: {board.marker:g}"]
    return ", ".join(values)


def _planar_lines(found: Found) -> list[str]:
    return [
        "",
        "  # material points of one camera, followed from step to step: everything in pixels",
        "  plane: {stage: undistort, images: photos}",
        _region_line(found, "plane"),
        *_correlation_lines("plane"),
    ]


def _correlation_lines(images: str) -> list[str]:
    return [
        f"  features: {{stage: features, images: {images}, detector: AKAZE}}",
        f"  matches: {{stage: match, images: {images}, guided: false, refine: false}}  # where the search starts",
        f"  correlation: {{stage: correlate, images: {images}, subset_size: 31, step_size: 7}}  # 3 speckles at least",
    ]


def _region_line(found: Found, images: str) -> str:
    given = f", {_quoted('file', found.region)}" if found.region else ""
    note = "" if given else "  # finds the speckled specimen; or give a rectangle, polygons or a file"
    return f"  region: {{stage: region, images: {images}{given}}}{note}"


def _result_lines(found: Found) -> list[str]:
    points = "points" if found.photos.right else "correlation"
    return [
        "",
        "  # displacement and strain since the first step, with their standard deviations",
        f"  total: {{stage: deformation, points: {points}, window: 50 px}}",
        *_gauge_lines(found),
        *_comparison_lines(found),
        "  maps: {stage: maps}",
    ]


def _gauge_lines(found: Found) -> list[str]:
    if found.gauge is None:
        return []
    ends = ", ".join(f"[{x}, {y}]" for x, y in found.gauge.ends)
    return [
        "",
        f"  # an extensometer along the load, {found.gauge.axis} ({found.gauge.reason}); ends [x, y] in px",
        f"  probes: {{stage: probes, extensometers: {{{_GAUGE}: [{ends}]}}}}",
    ]


def _comparison_lines(found: Found) -> list[str]:
    if found.caliper is None or found.caliper.obstacle:
        return []
    values = ["stage: compare", _quoted("caliper", found.caliper.name)]
    if found.gauge:
        values.append(f"extensometer: {_GAUGE}")
    if found.gauge and found.gauge.axis == "x":
        values.append("axis: x")
    return [f"  compare: {{{', '.join(values)}}}"]
