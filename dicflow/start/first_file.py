"""A first pipeline file for a folder of photographs."""

from __future__ import annotations

import json
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from dicflow.engine.files import FilePart
from dicflow.engine.node import Node
from dicflow.errors import InputError, StageError
from dicflow.io.configuration import parse
from dicflow.io.images import SUFFIXES, read_grey
from dicflow.kinds.disparity import DisparityMap
from dicflow.pipeline.registry import node_class
from dicflow.pipeline.wiring import wire

__all__ = ["OPEN", "Found", "Series", "look", "pipeline_text"]

OPEN = "FILL IN the side"
"""Marks what the user has to fill in."""


_SIDE_WORDS = {"left": "left", "l": "left", "right": "right", "r": "right"}
_SIDE_WORD = re.compile(r"(?:^|[^a-z])(left|right|l|r)(?=[^a-z]|$)|(Left|Right)(?=[0-9_]|$)", re.IGNORECASE)
_CAMERA_NUMBER = re.compile(r"(?:cam(?:era)?[ _-]?|[_-])([0-2])$", re.IGNORECASE)
_SKIPPED = {"results", "export", "truth", "reference"}
_DEPTH = 4
_PAIRS_FOR_RANGE = 10
_LOOKS = 5
_LEAST_CORNERS = 4


class Series(NamedTuple):
    """Photographs of one subject.

    left, right : patterns below the folder; right is None for one camera
    steps : files of each step, as the stage of the photographs finds them
    """

    left: str
    right: str | None
    steps: Mapping[str, Mapping[str, Path | FilePart]]

    def __str__(self) -> str:
        cameras = "pairs" if self.right else "photographs of one camera"
        return f"{len(self.steps)} {cameras}, {self.left}" + (f" and {self.right}" if self.right else "")


class Found(NamedTuple):
    """Content of a folder.

    board_size : inner corners (columns, rows) of the board
    disparity_range : least and largest disparity of the first pair in the rectified photographs [px]
    region, caliper : names of files that the pipeline can use
    """

    photos: Series
    boards: Series | None
    board_size: tuple[int, int] | None
    disparity_range: tuple[int, int] | None
    region: str | None
    caliper: str | None


def look(folder: Path, say: Callable[[str], None]) -> Found:
    """Find the photographs, the boards, their size and the range of disparity.

    folder : searched to a depth of three folders
    say : called with each finding
    Raises InputError without photographs of a specimen.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; name the folder that holds the photographs")
    series = _series(folder)
    sizes = {one.left: _board_size(one) for one in series}
    photos = _best([one for one in series if not sizes[one.left]])
    boards = _best([one for one in series if sizes[one.left]])
    if photos is None:
        found = f"only those of a board ({boards})" if boards else f"expected {', '.join(SUFFIXES)} in it or below"
        raise InputError(f"{folder}: no photographs of a specimen found, {found}; name the folder that holds them")
    say(f"specimen: {photos}")
    size = sizes[boards.left] if boards else None
    if boards and size:
        say(f"boards: {boards}, {size[0]} × {size[1]} inner corners")
    for other in series:
        if other not in (photos, boards):
            say(f"left out: {other}")
    disparities = _disparity_range(photos, boards, size) if boards and size and photos.right else None
    if disparities:
        say("disparity of the first pair: {} … {} px".format(*disparities))
    return Found(photos, boards, size, disparities, _first(folder, "*.geojson"), _first(folder, "caliper*.csv"))


def _series(folder: Path) -> list[Series]:
    """Photographs grouped by folder; names of folders or files distinguish the two cameras.

    A word or number in a name counts only if the other camera has one too.
    """
    groups: dict[Path, dict[str, list[Path]]] = defaultdict(lambda: defaultdict(list))
    for path in _photographs(folder):
        in_folder = path.parent != folder and _side(path.parent.name)
        base, side = (path.parent.parent, in_folder) if in_folder else (path.parent, _side(path.stem))
        groups[base][side or ""].append(path)
    series = []
    for sides in groups.values():
        if {"left", "right"} <= sides.keys():
            series.append(_found_by(folder, {side: _pattern(folder, sides, side) for side in ("left", "right")}))
        else:
            parents = dict.fromkeys(path.parent for paths in sides.values() for path in paths)
            series += [_found_by(folder, {"left": _pattern_of_all(folder, parent, sides)}) for parent in parents]
    return series


def _found_by(folder: Path, patterns: Mapping[str, str]) -> Series:
    """The photographs that patterns name."""
    try:
        steps = _maker("images")(**patterns).steps(folder) or {}
    except InputError as error:
        raise InputError(f"{folder / patterns['left']}: {error}") from error
    return Series(patterns["left"], patterns.get("right"), steps)


def _photographs(folder: Path) -> list[Path]:
    depth = len(folder.parts)
    return sorted(
        path
        for path in folder.rglob("*")
        if path.suffix.lower() in SUFFIXES
        and len(path.parts) <= depth + _DEPTH
        and not any(part in _SKIPPED or part.startswith(".") for part in path.parts[depth:-1])
    )


def _side(name: str) -> str | None:
    """The camera in a name: by a word, else by a number at its end; None if unknown."""
    word = _SIDE_WORD.search(name)
    if word:
        return _SIDE_WORDS[(word[1] or word[2]).lower()]
    number = _CAMERA_NUMBER.search(name)
    return {"0": "left", "1": "right"}.get(number[1]) if number else None


def _pattern(folder: Path, sides: Mapping[str, list[Path]], side: str) -> str:
    """A pattern that finds the files of one camera and none of the other's."""
    first = sides[side][0]
    if all(path.parent != first.parent for other in sides if other != side for path in sides[other]):
        return _pattern_of_all(folder, first.parent, sides)
    word = _SIDE_WORD.search(first.stem)
    sign = f"{word[1] or word[2]}*" if word else first.stem[-2:]
    return _pattern_of_all(folder, first.parent, sides).replace("*", f"*{sign}")


def _pattern_of_all(folder: Path, parent: Path, sides: Mapping[str, list[Path]]) -> str:
    """A pattern that finds all photographs in one folder that end like the first."""
    suffix = next(path.suffix for paths in sides.values() for path in paths if path.parent == parent)
    where = parent.relative_to(folder).as_posix()
    return f"*{suffix}" if where == "." else f"{where}/*{suffix}"


def _best(series: list[Series]) -> Series | None:
    """The series of two cameras, else of most photographs."""
    return max(series, key=lambda one: (one.right is not None, len(one.steps)), default=None)


def _board_size(series: Series) -> tuple[int, int] | None:
    """Size of the board in most of a few photographs; speckles may look like a small one here and there."""
    from dicflow.core.calibration.targets import board_size

    steps = list(series.steps.values())
    looked_at = [steps[k * len(steps) // _LOOKS] for k in range(_LOOKS)] if len(steps) > _LOOKS else steps
    sizes = Counter(board_size(read_grey(files["left"])) for files in looked_at)
    size, count = sizes.most_common(1)[0]
    is_board = size is not None and min(size) >= _LEAST_CORNERS and 2 * count > len(looked_at)
    return size if is_board else None


def _disparity_range(photos: Series, boards: Series, size: tuple[int, int]) -> tuple[int, int] | None:
    """The range that the first pair shows, with a rig from a few of the boards; None if these do not calibrate."""
    images, corners, calibrate, rectify, disparity = (
        _maker(name) for name in ("images", "corners", "calibrate", "rectify", "disparity")
    )
    read = images(left=photos.left, right=photos.right)
    finder = corners(size=size)
    every = max(1, len(boards.steps) // _PAIRS_FOR_RANGE)
    try:
        found = tuple(finder.run(images=read.run(**files)) for files in list(boards.steps.values())[::every])
        rig = calibrate(square=1.0).run(corners=found)
        pair = rectify().run(images=read.run(**next(iter(photos.steps.values()))), rig=rig)
        product = disparity().run(pair=pair, rig=rig)
    except StageError:
        return None
    low, high = DisparityMap.read(product).limits
    return int(low), int(high)


def _maker(stage: str) -> Callable[..., Node]:
    """The node of a stage as a function of its parameters."""
    return node_class(stage)


def _first(folder: Path, pattern: str) -> str | None:
    return next((path.name for path in sorted(folder.glob(pattern))), None)


def pipeline_text(found: Found, square: str | None, path: Path) -> str:
    """The pipeline file, commented: two cameras with boards where both were found, else one camera.

    square : side of a square of the board; None leaves it for the user to fill in
    path : of the file, for messages
    Raises ConfigurationError if the square is not a length, or a name cannot be written.
    """
    wire(parse(_text(found, square or "1 mm"), str(path)))
    return _text(found, square)


def _text(found: Found, square: str | None) -> str:
    lines = [
        "dicflow: 1",
        "stages:",
        "  # photographs of the specimen, in the order of the steps; the first is the reference",
    ]
    lines.append(f"  photos: {{stage: images, {_quoted('left', found.photos.left)}{_right(found.photos)}}}")
    stereo = found.boards is not None and found.photos.right is not None
    lines += _stereo_lines(found, square) if stereo else _planar_lines(found)
    lines += _common_lines(found, stereo)
    return "\n".join(lines) + "\n"


def _quoted(key: str, value: str) -> str:
    """A key and its value, quoted so that YAML reads any characters back; JSON's strings are YAML's."""
    return f"{key}: {json.dumps(value, ensure_ascii=False)}"


def _right(series: Series) -> str:
    return f", {_quoted('right', series.right)}" if series.right else ""


def _stereo_lines(found: Found, square: str | None) -> list[str]:
    assert found.boards is not None
    assert found.board_size is not None
    columns, rows = found.board_size
    side = square or f"  # {OPEN} of one square as you measured it, such as 14.5 mm"
    range_note = (
        "  # disparity of the first pair: {} … {} px".format(*found.disparity_range or ())
        if found.disparity_range
        else ""
    )
    return [
        "",
        "  # the rig, from photographs of a checkerboard",
        f"  boards: {{stage: images, {_quoted('left', found.boards.left)}{_right(found.boards)}}}",
        f"  corners: {{stage: corners, images: boards, size: [{columns}, {rows}]}}  # inner corners: columns, rows",
        "  rig:",
        "    stage: calibrate",
        f"    square: {side}",
        "    tangential: true",
        "",
        "  # material points followed from step to step in the left photographs, and found in the right ones",
        _region_line(found, "photos"),
        *_correlation_lines("photos"),
        f"  stereo: {{stage: stereo, images: photos}}{range_note}",
        "  points: {stage: triangulate}",
    ]


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


def _common_lines(found: Found, stereo: bool) -> list[str]:
    lines = [
        "",
        "  # displacement and strain since the first step, with their standard deviations",
        f"  total: {{stage: deformation, points: {'points' if stereo else 'correlation'}, window: 50 px}}",
    ]
    if found.caliper:
        caliper = _quoted("caliper", found.caliper)
        lines.append(f"  compare: {{stage: compare, {caliper}}}  # or name an extensometer of a stage probes")
    return [*lines, "  maps: {stage: maps}"]
