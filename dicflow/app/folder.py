"""Pairs of photographs, and what a person leaves out of them: whole pairs, and single corners of boards."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from dicflow.app.document import problems, read_pipeline
from dicflow.app.project import Project
from dicflow.app.versions import change
from dicflow.engine.files import FilePart
from dicflow.errors import ConfigurationError
from dicflow.io.edited_yaml import REMOVED, Edit, edited
from dicflow.start.patterns import patterns_of

__all__ = ["edits_of_choice", "edits_to_leave_out", "leave_out", "listing", "pairs_of"]

Corners = Mapping[str, Mapping[str, Sequence[Sequence[float]]]]
"""Single corners that are left out: pair → left or right → places [px]."""


def listing(project: Project) -> int:
    """A number that changes with the names and times of the files in the folder of photographs."""
    found = []
    for folder, folders, names in os.walk(project.data_folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        found += [(folder, name, os.lstat(os.path.join(folder, name)).st_mtime_ns) for name in sorted(names)]
    return hash(tuple(found))


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


def edits_of_choice(
    project: Project, name: str, boards: str, without: Sequence[str], rig: str, corners: Corners | None
) -> list[Edit]:
    """Edits that leave pairs and single corners out of a calibration.

    boards : stage of the photographs, of which the pairs ``without`` go; rig : stage that calibrates
    corners : all that are to be left out; None leaves the file's as they are
    """
    edits = edits_to_leave_out(project, name, boards, without) if without else []
    given = getattr(project.pipeline(name).graph.stages[project.pipeline(name).instances[0][rig]].node, "leave_out", {})
    wanted = {pair: _named_sides(sides) for pair, sides in (given if corners is None else corners).items()}
    kept = {pair: sides for pair, sides in wanted.items() if sides and pair not in without}
    if kept != {pair: _named_sides(sides) for pair, sides in given.items()}:
        edits.append(Edit(("stages", rig, "leave_out"), kept or REMOVED))
    return edits


def _named_sides(sides: Mapping[str, Sequence[Sequence[float]]]) -> dict[str, list[list[float]]]:
    """Places as they stand in the file, of the sides that have any."""
    return {side: [[float(value) for value in place] for place in places] for side, places in sides.items() if places}
