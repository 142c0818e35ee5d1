"""What a measurement came to: its maps, its report, and files for other programs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dicflow.app.project import Project
from dicflow.errors import ConfigurationError, InputError
from dicflow.pipeline import Pipeline, Result
from dicflow.views.published import Published

__all__ = ["REPORT_POLICY", "export_files", "export_formats", "map_picture", "maps_of", "report_page", "write_report"]

REPORT_POLICY = (
    "sandbox allow-scripts allow-popups allow-downloads; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; connect-src data: blob:; frame-ancestors 'none'"
)
"""The report is a page of its own, which can ask the app nothing."""
_MAP = re.compile(r"(?P<folder>.+)/(?P<quantity>[^/]+)/(?P<step>[^/]+)\.png")


def _folder(project: Project, pipeline: Pipeline) -> Path:
    """The folder of results, beside the file as the command line has it."""
    return project.path(f"results/{pipeline.name}")


def maps_of(project: Project, name: str) -> dict[str, Any]:
    """``maps`` of the last run, each with ``folder``, ``quantity`` and ``steps`` → file; ``report``: if it is there."""
    pipeline = project.pipeline(name)
    folder = _folder(project, pipeline)
    found: dict[tuple[str, str], dict[str, str]] = {}
    for file in Published(folder).listed:
        if match := _MAP.fullmatch(file):
            found.setdefault((match["folder"], match["quantity"]), {})[match["step"]] = file
    rows = [{"folder": key[0], "quantity": key[1], "steps": steps} for key, steps in found.items()]
    return {"maps": rows, "report": (folder / "report.html").is_file()}


def map_picture(project: Project, name: str, file: str) -> bytes:
    """A map that dicflow wrote and nobody has changed since. Raises InputError for anything else."""
    content = None
    if _MAP.fullmatch(file):
        content = Published(_folder(project, project.pipeline(name))).content(file)
    if content is None:
        raise InputError(file[:80], "is no map of the last run", "run it again")
    return content


def report_page(project: Project, name: str) -> bytes:
    """The report. Raises InputError before it is written."""
    path = project.path(f"results/{project.pipeline(name).name}/report.html")
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(str(path), "is not written yet", "run the test, or write the report") from error


def write_report(project: Project, name: str) -> dict[str, Any]:
    """Write the report of what the store holds, as ``dicflow report`` does. Returns its ``path`` and ``notes``."""
    from dicflow.report.build import write_report as write

    pipeline = project.pipeline(name)
    result = pipeline.result()
    notes = list(result.notes)
    path = write(pipeline, result, _folder(project, pipeline), 1, notes.append)
    return {"path": project.name_of(path), "notes": notes}


def export_formats(project: Project, name: str) -> dict[str, Any]:
    """``formats``: name → description; ``stages``: those with products, each with the steps that are stored."""
    from dicflow.io.exports import descriptions
    from dicflow.views.exported_pictures import PICTURES

    result = project.pipeline(name).result()
    return {
        "formats": {**descriptions(), **{form: picture.description for form, picture in PICTURES.items()}},
        "stages": {stage: steps for stage in result.stages if (steps := _stored(result, stage)) is not None},
    }


def _stored(result: Result, stage: str) -> list[str] | None:
    """Steps of a stage that are stored; None where it has no product at all."""
    steps = result.steps(stage)
    if not steps:
        return [] if result.has(stage) else None
    found = [step for step in steps if result.has(stage, step)]
    return found or None


def export_files(project: Project, name: str, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Write files as ``dicflow export`` does. Returns the ``files``, and ``notes`` on what was left out.

    asked : ``format``, ``folder``, ``force``, and perhaps ``stage``, ``step`` and ``quantities``
    Raises ConfigurationError for what does not exist, and for files that exist unless ``force`` is set.
    """
    from dicflow.views.exports import Selection, export

    folder = str(asked.get("folder") or "export")
    if Path(folder).is_absolute():
        raise ConfigurationError(f"{folder}: name a folder below {project.folder.name}")
    pipeline = project.pipeline(name)
    result = pipeline.result()
    notes = list(result.notes)
    selection = Selection(asked.get("stage") or None, asked.get("step") or None, tuple(asked.get("quantities") or ()))
    paths = export(
        result,
        project.path(folder),
        selection,
        to=str(asked["format"]),
        force=bool(asked.get("force")),
        name=pipeline.name,
        note=notes.append,
    )
    return {"files": [project.name_of(path) for path in paths], "notes": notes}
