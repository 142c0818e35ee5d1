"""What a measurement came to: its report, and files for other programs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dicflow.app.project import Project
from dicflow.errors import ConfigurationError, InputError
from dicflow.pipeline import Pipeline, Result

__all__ = ["REPORT_POLICY", "export_files", "export_formats", "has_report", "report_page", "write_report"]

REPORT_POLICY = (
    "sandbox allow-scripts allow-popups allow-downloads; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; connect-src data: blob:; frame-ancestors 'none'"
)
"""The report is a page of its own, which can ask the app nothing."""


def _folder(project: Project, pipeline: Pipeline) -> Path:
    """The folder of results, beside the file as the command line has it."""
    return project.path(f"results/{pipeline.name}")


def has_report(project: Project, name: str) -> bool:
    """Whether the report is written."""
    return (_folder(project, project.pipeline(name)) / "report.html").is_file()


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
