"""What a measurement came to: its report, and files for other programs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dicflow.app.project import Project
from dicflow.errors import ConfigurationError, InputError, NotKeptError
from dicflow.pipeline import Pipeline, Result
from dicflow.pipeline.report_facts import ReportFacts

__all__ = [
    "REPORT_POLICY",
    "export_files",
    "export_formats",
    "facts_of",
    "has_report",
    "report_page",
    "resolution_of",
    "rest_of",
    "write_report",
]

REPORT_POLICY = (
    "sandbox allow-scripts allow-popups allow-downloads; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; connect-src data: blob:; frame-ancestors 'none'"
)
"""The report is a page of its own, which can ask the app nothing."""
_LOGOS = (".png", ".jpg", ".jpeg")
_MOST_LOGOS = 50


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


def facts_of(project: Project, name: str) -> dict[str, Any]:
    """What the report states and no photograph shows: the section ``report`` of a pipeline file.

    ``facts``: each with ``name``, ``words`` on what belongs there, and ``value``, "" where it is not given; ``logos``:
    files beside the pipeline file that can be the logo.
    """
    pipeline = project.pipeline(name)
    given = pipeline.facts
    facts = [
        {"name": fact, "words": field.description, "value": getattr(given, fact) or ""}
        for fact, field in ReportFacts.model_fields.items()
    ]
    beside = sorted(one.name for one in pipeline.path.parent.iterdir() if one.suffix.lower() in _LOGOS)
    return {"facts": facts, "logos": beside[:_MOST_LOGOS]}


def resolution_of(project: Project, name: str) -> dict[str, Any]:
    """Noise against resolution of the variants of a sweep, as its report has it.

    ``chart``: SVG, None where all variants have one gauge or nothing is measured; ``unit`` of the gauge; ``measured``:
    whether σ was measured where nothing deforms; ``variants``: each with its ``name``, ``side`` of the gauge and
    ``sigma`` by symbol of the strain, None if unknown.
    """
    from dicflow.kinds.quantities import QUANTITIES
    from dicflow.report.resolution import resolution_chart, resolutions
    from dicflow.views.variant_names import variant_names

    result = project.pipeline(name).result()
    found, names = resolutions(result), variant_names(result.values)
    known = [one for one in found if one is not None]
    variants = [
        {
            "name": label,
            "side": None if one is None else one.side,
            "sigma": {} if one is None else {QUANTITIES[name].symbol: sigma for name, sigma in one.sigma.items()},
        }
        for label, one in zip(names, found, strict=True)
    ]
    return {
        "chart": resolution_chart(found, names),
        "unit": known[0].unit if known else "",
        "measured": any(one.measured for one in known),
        "variants": variants,
    }


def rest_of(project: Project, name: str) -> list[str]:
    """How far each extensometer scatters at steps at rest, beside its stated σ, in sentences; empty without any."""
    from dicflow.report.rest import at_rest

    try:
        found = at_rest(project.pipeline(name).result(), lambda _sources, make: make())
    except NotKeptError:
        return []
    return [] if found is None else found.probes


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
