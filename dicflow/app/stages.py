"""The stages of a pipeline for the page: the graph, and each parameter with its words, limits and value."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from inspect import getdoc
from typing import Any

from dicflow.engine.node import Node, port_of
from dicflow.errors import ConfigurationError
from dicflow.pipeline import Pipeline
from dicflow.pipeline.registry import node_class
from dicflow.pipeline.stage_words import allowed

__all__ = ["graph_of", "parameters_of"]


def graph_of(pipeline: Pipeline) -> list[dict[str, Any]]:
    """Stages in the order of the file: name, stage, title, kind of product, and the stages it takes from."""
    resolved = pipeline.resolved()["stages"]
    names = pipeline.instances[0]
    back = {instance: name for name, instance in names.items()}
    stages = []
    for name, instance in names.items():
        entry = resolved[instance]
        kind = node_class(entry["stage"])
        takes = dict.fromkeys(back[other] for other in entry["inputs"].values())
        stages.append(
            {"name": name, "stage": entry["stage"], "title": kind.title, "gives": kind.gives, "takes": list(takes)}
        )
    return stages


def parameters_of(pipeline: Pipeline, name: str) -> dict[str, Any]:
    """All about one stage of the file. Raises ConfigurationError for an unknown one.

    ``about``: paragraphs on the stage; ``parameters``: each with ``name``, ``words`` (its sentence), ``unit``,
    ``allowed`` (limits in words), ``choices`` (None, or the values there are), ``default``, ``value`` and whether it is
    ``given`` in the file; ``inputs``: each with its kinds, the stage joined to it (a list where it takes
    ``several``), and the stages that fit.
    """
    names = pipeline.instances[0]
    if name not in names:
        raise ConfigurationError(f"no stage '{name}'; stages: {', '.join(names)}")
    entry = pipeline.document.data["stages"][name]
    instance = pipeline.resolved()["stages"][names[name]]
    kind = node_class(entry["stage"])
    return {
        "name": name,
        "stage": entry["stage"],
        "title": kind.title,
        "about": [" ".join(part.split()) for part in (getdoc(kind) or "").split("\n\n")],
        "parameters": [_with_names(one, pipeline, instance) for one in _parameters(kind, entry, instance)],
        "inputs": list(_inputs(pipeline, kind, name, entry)),
    }


def _parameters(kind: type[Node], entry: Mapping[str, Any], values: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    schema = kind.model_json_schema()
    followed = {parameter: port for port, names in kind.follows.items() for parameter in names}
    shared = [name for name in schema["properties"] if name not in kind.__annotations__]
    for name in [*(name for name in schema["properties"] if name not in shared), *shared]:
        own = schema["properties"][name]
        if name != "stage":
            yield {
                "name": name,
                "words": own.get("description", ""),
                "unit": own.get("unit", ""),
                "allowed": allowed(own, schema.get("$defs", {})),
                "choices": _choices(own),
                "default": f"as in {followed[name]}" if name in followed else _text(own.get("default")),
                "value": _text(entry[name] if name in entry else values.get(name)),
                "given": name in entry,
                "affects": own.get("affects", "result"),
            }


def _with_names(parameter: dict[str, Any], pipeline: Pipeline, instance: Mapping[str, Any]) -> dict[str, Any]:
    """A parameter that names a probe, with the names of the probes as choices."""
    if parameter["name"] != "extensometer" or "probes" not in instance["inputs"]:
        return parameter
    probes = pipeline.resolved()["stages"][instance["inputs"]["probes"]]
    return {**parameter, "choices": ["null", *(probes["extensometers"] or ())]}


def _choices(own: Mapping[str, Any]) -> list[str] | None:
    """The values of a parameter that takes a few words only."""
    if own.get("type") == "boolean":
        return ["true", "false"]
    forms = own.get("anyOf", [own])
    if all("enum" in form or "const" in form or form.get("type") == "null" for form in forms):
        return [_text(value) for form in forms for value in form.get("enum", [form.get("const")])]
    return None


def _text(value: Any) -> str:
    """A value as a pipeline file has it."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _inputs(pipeline: Pipeline, kind: type[Node], name: str, entry: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    names = pipeline.instances[0]
    back = {instance: other for other, instance in names.items()}
    joined = pipeline.resolved()["stages"][names[name]]["inputs"]
    gives = {other: node_class(pipeline.document.data["stages"][other]["stage"]).gives for other in names}
    for port_name, port in kind.takes.items():
        if not port.own and not port_name.endswith(("_before", "_first", "_early")):
            sources = [back[instance] for given, instance in joined.items() if port_of(given) == port_name]
            yield {
                "name": port_name,
                "kinds": list(port.kinds),
                "optional": port.optional,
                "several": port.several,
                "value": sources if port.several else next(iter(sources), None),
                "given": port_name in entry,
                "fitting": [other for other, given in gives.items() if given in port.kinds and other != name],
            }
