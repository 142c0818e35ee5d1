"""The folder's photographs: series and proposed roles, the first pipeline file, and pairs that are left out."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from dicflow.app.document import problems, read_pipeline
from dicflow.app.project import Project
from dicflow.app.versions import MISSING, change
from dicflow.engine.files import FilePart
from dicflow.errors import ConfigurationError
from dicflow.io.edited_yaml import Edit, edited
from dicflow.start.choice import Candidate, Choice
from dicflow.start.first_file import OPEN, pipeline_text
from dicflow.start.folder import Survey, look, survey
from dicflow.start.layouts import Series
from dicflow.start.patterns import listed, patterns_of

__all__ = ["ROLES", "edits_to_leave_out", "found_in", "leave_out", "listing", "make_pipeline", "pairs_of"]

ROLES = {
    "left": "specimen, left camera",
    "right": "specimen, right camera",
    "left_boards": "board, left camera",
    "right_boards": "board, right camera",
    "": "left out",
}
"""What a series of photographs can be."""
_FILE = "pipeline.yaml"
_SORTS = ("specimen", "board", "named like boards, but no board is recognised", "cannot be read")


def found_in(project: Project) -> dict[str, Any]:
    """The series in the project's folder of photographs, each with the role that is proposed.

    ``series``: each with ``names`` of its files for the project, its ``pattern``, what it ``shows``, and ``role``;
    ``reason``: why the proposal is not certain, "" if it is; ``calibration``: a file with the rig; ``single``: names
    that fit no series.
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
            "role": used.get(one, ""),
        }
        for shows, group in zip(_SORTS, found.subjects, strict=True)
        for one in group
    ]
    in_series = {path for group in found.subjects for one in group for path in one.files}
    return {
        "series": rows,
        "roles": ROLES,
        "reason": found.undecided.reason if found.undecided is not None else "",
        "calibration": found.calibration,
        "single": sorted(str(path) for path in set(found.paths) - in_series),
    }


def listing(project: Project) -> int:
    """A number that changes with the names and times of the files in the folder of photographs."""
    found = []
    for folder, folders, names in os.walk(project.data_folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        found += [(folder, name, os.lstat(os.path.join(folder, name)).st_mtime_ns) for name in sorted(names)]
    return hash(tuple(found))


def _roles(candidate: Candidate) -> dict[Series | None, str]:
    boards = candidate.boards
    return {
        candidate.left: "left",
        candidate.right: "right",
        **({boards.left: "left_boards", boards.right: "right_boards"} if boards else {}),
    }


def make_pipeline(project: Project, roles: Sequence[Mapping[str, Any]], square: str) -> dict[str, Any]:
    """Write pipeline.yaml as ``dicflow init`` does, for series with the roles that a person gave them.

    roles : for each series its first file for the project, ``name``, and its ``role``
    square : side of the board's squares, such as "14.5 mm"; "" leaves it to be filled in
    Returns the ``file``, and ``said``: what was found.
    Raises ConfigurationError if the roles do not give a measurement, or if the file exists.
    """
    folder = project.data_folder
    choice = _choice(survey(folder, Choice()), {_relative(project, one["name"]): str(one["role"]) for one in roles})
    said: list[str] = []
    text = pipeline_text(
        look(folder, choice, ["dicflow", "init", str(folder)], said.append), square or None, Path(_FILE)
    )
    if (project.folder / _FILE).exists():
        raise ConfigurationError(f"{_FILE} exists; open it, or rename it first")
    change(project, {_FILE: MISSING}, {_FILE: text.encode()}, f"{_FILE} made")
    return {"file": _FILE, "said": said, "open": OPEN in text}


def _relative(project: Project, name: str) -> str:
    return project.path(name).relative_to(project.data_folder.resolve()).as_posix()


def _choice(found: Survey, roles: Mapping[str, str]) -> Choice:
    """Arguments of ``dicflow init`` for these series. roles : by the first file of a series"""
    patterns: dict[str, list[str]] = {role: [] for role in ROLES}
    for one in (one for group in found.subjects for one in group):
        patterns[roles.get(str(one.files[0]), "")] += patterns_of(one.files, found.paths)
    if not patterns["left"]:
        raise ConfigurationError("no photographs of the specimen by the left camera; say which series they are")
    boards = tuple(patterns["left_boards"] + patterns["right_boards"])
    left = tuple(patterns["left"] + patterns["left_boards"])
    if not patterns["right"]:
        return Choice(left, (), boards, one_camera=True)
    return Choice(left, tuple(patterns["right"] + patterns["right_boards"]), boards)


def pairs_of(project: Project, name: str, stage: str) -> dict[str, Any]:
    """The steps of a stage of photographs: ``steps``, each with its name and its left and right file."""
    pipeline = project.pipeline(name)
    if not pipeline.graph.files.get(stage):
        raise ConfigurationError(f"no stage '{stage}' with photographs; there are {', '.join(pipeline.graph.files)}")
    steps = [
        {"name": step, **{side: _name(project, file) for side, file in files.items()}}
        for step, files in pipeline.graph.files[stage].items()
    ]
    return {"stages": list(pipeline.graph.files), "steps": steps}


def _name(project: Project, file: Path | FilePart) -> str:
    return project.name_of(project.path(str(file.path if isinstance(file, FilePart) else file)))


def edits_to_leave_out(project: Project, name: str, stage: str, out: Sequence[str]) -> list[Edit]:
    """Edits that make the photographs of a stage a list without some steps. Raises ConfigurationError for pages."""
    pipeline = project.pipeline(name)
    files = pipeline.graph.files[stage]
    kept = [found for step, found in files.items() if step not in out]
    if any(isinstance(file, FilePart) for found in kept for file in found.values()):
        raise ConfigurationError(f"{stage}: its steps are pages of one file; save the good ones as files of their own")
    if not kept:
        raise ConfigurationError(f"{stage}: no photograph would be left; leave out fewer")
    folder = project.data_folder.resolve()
    sides = {side: [_below(folder, found[side]) for found in kept] for side in kept[0]}
    return [Edit(("stages", stage, side), names) for side, names in sides.items()]


def _below(folder: Path, file: Any) -> str:
    """The relative name of a photograph, with the signs of patterns escaped."""
    path = PurePosixPath(Path(file).resolve().relative_to(folder).as_posix())
    return patterns_of([path], [path])[0]


def leave_out(project: Project, name: str, stage: str, out: Sequence[str], seen: str) -> None:
    """Leave steps out: the stage then lists its photographs one by one. Raises Conflict, ConfigurationError."""
    text = read_pipeline(project, name).text
    source = str(project.path(name))
    new = edited(text, source, edits_to_leave_out(project, name, stage, out))
    if left := problems(new, source):
        raise ConfigurationError("\n".join(left))
    change(project, {name: seen}, {name: new.encode()}, f"{stage}: without {', '.join(out)[:80]}")
