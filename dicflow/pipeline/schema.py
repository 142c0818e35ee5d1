"""JSON schema of pipeline files, for completion and checks in an editor."""

from __future__ import annotations

from typing import Any

from pydantic.json_schema import models_json_schema

from dicflow.engine.node import Node
from dicflow.pipeline.registry import node_classes
from dicflow.pipeline.report_facts import ReportFacts
from dicflow.pipeline.wiring import FORMAT

__all__ = ["pipeline_schema"]


def pipeline_schema() -> dict[str, Any]:
    """The schema: each stage's parameters with defaults, units and descriptions, and its inputs.

    Plug-ins that cannot be used are left out; :func:`dicflow.pipeline.registry.node_classes` says why.
    """
    kinds = node_classes()[0].values()
    references, whole = models_json_schema([(kind, "validation") for kind in kinds])
    definitions = whole["$defs"]
    stages = [_stage_schema(kind, definitions.pop(_name(references[kind, "validation"]))) for kind in kinds]
    values = {"type": "object", "additionalProperties": {"type": "array", "minItems": 1}}
    rows = {"type": "array", "items": {"type": "object"}}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "dicflow pipeline",
        "type": "object",
        "required": ["stages"],
        "additionalProperties": False,
        "properties": {
            "dicflow": {"const": FORMAT, "description": "version of the file's format"},
            "title": {"type": "string"},
            "report": ReportFacts.model_json_schema(),
            "stages": {"type": "object", "minProperties": 1, "additionalProperties": {"oneOf": stages}},
            "sweep": {
                "type": "object",
                "additionalProperties": False,
                "properties": {"grid": values, "zip": values, "list": rows, "exclude": rows},
            },
        },
        "$defs": definitions,
    }


def _name(reference: dict[str, Any]) -> str:
    return str(reference["$ref"]).rpartition("/")[2]


def _stage_schema(kind: type[Node], schema: dict[str, Any]) -> dict[str, Any]:
    """A stage's schema with its inputs."""
    for port_name, port in kind.takes.items():
        if not port.own:
            types = ["string", *(["null"] if port.optional else []), *(["array"] if port.several else [])]
            description = f"stage that gives {' or '.join(port.kinds)}"
            schema["properties"][port_name] = {"type": types, "description": description}
    schema["required"] = sorted({"stage", *schema.get("required", [])})
    return schema
