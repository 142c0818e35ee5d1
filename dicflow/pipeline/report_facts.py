"""The section ``report:`` of a pipeline file: what a report must state and no photograph shows."""

from __future__ import annotations

from pathlib import PurePosixPath, PureWindowsPath
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from dicflow.io.configuration import Document
from dicflow.pipeline.complaints import complaints

__all__ = ["ReportFacts", "check_report_facts", "report_facts"]

Words = Annotated[str, StringConstraints(strict=True, strip_whitespace=True, min_length=1, max_length=2000)]


def _beside(name: str) -> str:
    """A relative path that leads nowhere upwards, on any system."""
    for path in (PurePosixPath(name), PureWindowsPath(name)):
        if path.anchor or ".." in path.parts:
            raise ValueError("must be a path below the pipeline file's folder")
    return name


class ReportFacts(BaseModel):
    """What the user states of a test. Nothing of it enters a key, so that a change computes nothing."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    specimen: Words | None = Field(None, description="geometry and surface of the specimen")
    material: Words | None = Field(None, description="material of the specimen")
    pattern: Words | None = Field(None, description="how the pattern was made: paint, print, stencil, …")
    camera: Words | None = Field(None, description="maker and model, sensor and its pixel size")
    lens: Words | None = Field(None, description="maker and model, focal length in mm, filters")
    aperture: Words | None = Field(None, description="f-number, such as f/5.6")
    exposure: Words | None = Field(None, description="exposure time in ms, and how the cameras were triggered")
    rate: Words | None = Field(None, description="image acquisition rate in Hz, or when each photograph was taken")
    light: Words | None = Field(None, description="kind and place of the lamps, polarisers")
    operator: Words | None = Field(None, description="who did the test")
    laboratory: Words | None = Field(None, description="where it was done")
    remark: Words | None = Field(None, description="anything else that a reader must know")
    logo: Annotated[Words, AfterValidator(_beside)] | None = Field(
        None, description="a PNG or JPEG file in the pipeline file's folder"
    )


def check_report_facts(document: Document, problems: list[str]) -> None:
    """Check the section of a file, if it has one. problems : takes a line for each, with its place"""
    given = document.data.get("report")
    if given is None:
        return
    if not isinstance(given, dict):
        keys = ", ".join(ReportFacts.model_fields)
        problems.append(f"{document.where(('report',))}: 'report:' must map names to texts; names: {keys}")
        return
    try:
        ReportFacts.model_validate(given)
    except ValidationError as error:
        problems += complaints(document, ("report",), ReportFacts, error, tuple(ReportFacts.model_fields))


def report_facts(document: Document) -> ReportFacts:
    """The section of a checked file; empty if it has none."""
    return ReportFacts.model_validate(document.data.get("report") or {})
