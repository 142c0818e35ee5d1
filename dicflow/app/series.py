"""The folder's photographs as series with proposed roles, and the first pipeline file: work with numerics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from dicflow.app.project import USUAL, Project, is_blank
from dicflow.app.versions import MISSING, change, digest_of
from dicflow.errors import ConfigurationError
from dicflow.start.choice import Candidate, Choice, Undecided
from dicflow.start.facts import Facts
from dicflow.start.first_file import OPEN, pipeline_text
from dicflow.start.folder import look, photographs_in, survey
from dicflow.start.layouts import Series
from dicflow.start.patterns import listed, patterns_of
from dicflow.start.ways import Way, usual_way, ways_to_pair

__all__ = ["ROLES", "found_in", "make_pipeline", "pairings_of"]

ROLES = {
    "left": "specimen, left camera",
    "right": "specimen, right camera",
    "left_boards": "board, left camera",
    "right_boards": "board, right camera",
    "": "left out",
}
"""What a series of photographs can be."""
_PAIRED = (("specimen", "left", "right"), ("board", "left_boards", "right_boards"))
"""Subjects, and the roles of their left and right photographs."""
_SORTS = ("specimen", "board", "named like boards, but no board is recognised", "cannot be read")


def found_in(project: Project) -> dict[str, Any]:
    """The series in the project's folder of photographs, each with the role that is proposed.

    ``series``: each with ``names`` of its files for the project, its ``pattern``, what it ``shows``, and ``role``;
    ``reason``: why the proposal is not certain, "" if it is; ``calibration``: a file with the rig; ``copies``:
    photographs that are there twice; ``single``: names that fit no series.
    Raises InputError if the folder holds no photographs of a specimen.
    """
    folder = project.data_folder
    found = survey(folder, Choice())
    used = _roles(found.candidates[0]) if found.candidates else {}
    rows = [
        {
            "names": [project.name_of(folder / path) for path in one.files],
            "pattern": listed(patterns_of(one.files, found.paths)),
            "shows": shows,
            "camera": one.camera,
            "role": used.get(one, ""),
        }
        for shows, group in zip(_SORTS, found.subjects, strict=True)
        for one in group
    ]
    in_series = {path for group in found.subjects for one in group for path in one.files}
    return {
        "series": rows,
        "roles": ROLES,
        "reason": _reason(found.undecided) if found.undecided is not None else "",
        "calibration": found.calibration,
        "copies": list(map(str, found.copies)),
        "single": sorted(str(path) for path in set(found.paths) - in_series - set(found.copies)),
    }


def _reason(undecided: Undecided) -> str:
    return f"{undecided.reason}; {undecided.otherwise}" if undecided.otherwise else undecided.reason


def _roles(candidate: Candidate) -> dict[Series | None, str]:
    boards = candidate.boards
    return {
        candidate.left: "left",
        candidate.right: "right",
        **({boards.left: "left_boards", boards.right: "right_boards"} if boards else {}),
    }


def pairings_of(project: Project, series: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Ways to pair the photographs of two cameras, for each subject that both have taken.

    series : of each the ``names`` of its photographs for the project, in their order, and its ``role``
    Returns for each ``subject`` its ``ways``, each with ``by``, ``note``, the number of ``pairs``, and the ``first``
    and ``last`` of them as names; and ``usual``: the way that needs nobody to confirm it, or None.
    """
    facts, found = Facts(project.data_folder), []
    for subject, *sides in _PAIRED:
        files = [tuple(path for one in _with_role(project, series, role) for path in one) for role in sides]
        if all(files):
            left, right = (Series(one, ()) for one in files)
            ways = ways_to_pair(left, right, facts.taken)
            usual = usual_way(left, right, ways)
            shown = [_shown(project, way) for way in ways]
            found.append({"subject": subject, "ways": shown, "usual": usual and usual.by})
    return found


def _with_role(project: Project, series: Sequence[Mapping[str, Any]], role: str) -> list[list[PurePosixPath]]:
    """The files of each series that has a role."""
    return [[_relative(project, name) for name in one["names"]] for one in series if one["role"] == role]


def _shown(project: Project, way: Way) -> dict[str, Any]:
    ends = {
        end: [project.name_of(project.data_folder / path) for path in way.pairs[k]]
        for end, k in (("first", 0), ("last", -1))
    }
    return {"by": way.by, "note": way.note, "pairs": len(way.pairs), **ends}


def make_pipeline(
    project: Project, series: Sequence[Mapping[str, Any]], square: str, pair_by: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Write pipeline.yaml as ``dicflow init`` does, for series with the roles that a person gave them.

    series : as for :func:`pairings_of`
    square : side of the board's squares, such as "14.5 mm"; "" leaves it to be filled in
    pair_by : "specimen" and "board" → what makes their pairs, as :func:`pairings_of` names it
    Returns the ``file``, and ``said``: what was found.
    Raises ConfigurationError if the roles do not give a measurement, or if the file exists.
    """
    folder, ways = project.data_folder, pair_by or {}
    choice = _choice(project, series)._replace(pair_by=ways.get("specimen"), pair_boards_by=ways.get("board"))
    said: list[str] = []
    text = pipeline_text(
        look(folder, choice, ["dicflow", "init", str(folder)], said.append), square or None, Path(USUAL)
    )
    seen = digest_of(project, USUAL)
    if seen != MISSING and not is_blank(project.path(USUAL)):
        raise ConfigurationError(f"{USUAL} exists; open it, or rename it first")
    change(project, {USUAL: seen}, {USUAL: text.encode()}, f"{USUAL} made")
    return {"file": USUAL, "said": said, "open": OPEN in text}


def _relative(project: Project, name: str) -> PurePosixPath:
    return PurePosixPath(project.path(name).relative_to(project.data_folder.resolve()).as_posix())


def _choice(project: Project, series: Sequence[Mapping[str, Any]]) -> Choice:
    """Arguments of ``dicflow init`` for series with their roles."""
    photographs = photographs_in(project.data_folder)
    patterns = {
        role: [one for files in _with_role(project, series, role) for one in patterns_of(files, photographs)]
        for role in ROLES
    }
    if not patterns["left"]:
        raise ConfigurationError("no photographs of the specimen by the left camera; say which series they are")
    boards = tuple(patterns["left_boards"] + patterns["right_boards"])
    left = tuple(patterns["left"] + patterns["left_boards"])
    if not patterns["right"]:
        return Choice(left, (), boards, one_camera=True)
    return Choice(left, tuple(patterns["right"] + patterns["right_boards"]), boards)
