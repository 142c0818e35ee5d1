"""The stages in words: what each does, takes and gives, and its parameters with their limits."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator, Mapping
from inspect import getdoc
from typing import Any

from dicflow.engine.node import At, Node, Port, Scope

__all__ = ["SCOPES", "allowed", "list_lines", "stage_lines"]

_WIDTH = 79
_LIMITS = {
    "exclusiveMinimum": "above {}",
    "gt": "above {}",
    "minimum": "at least {}",
    "ge": "at least {}",
    "exclusiveMaximum": "below {}",
    "lt": "below {}",
    "maximum": "at most {}",
    "le": "at most {}",
}
_TYPES = {"integer": "whole number", "number": "number", "string": "text", "boolean": "true or false", "null": "null"}
SCOPES = {
    Scope.RIG: "once for the cameras",
    Scope.STEP: "once per step",
    Scope.PAIR: "once per step but the first",
    Scope.TEST: "once for the test",
}
_STEPS = {
    At.SAME: "",
    At.PREVIOUS: "of the previous step",
    At.FIRST: "of the first step",
    At.ALL: "of all steps",
    At.EARLY: "of a few early steps",
}


def list_lines(kinds: Mapping[str, type[Node]]) -> Iterator[str]:
    """Two lines per stage: its name, title and how often it runs; the products it takes and gives."""
    width = max(map(len, kinds))
    for name, kind in kinds.items():
        yield f"{name:{width}}  {kind.title}, {SCOPES[kind.scope]}"
        takes = dict.fromkeys(_kinds(port) for port in kind.takes.values() if not port.own)
        yield from _wrapped(f"{', '.join(takes)} → {kind.gives}".strip(), " " * (width + 2))


def stage_lines(name: str, kind: type[Node]) -> Iterator[str]:
    """All about one stage: its description, inputs, product and parameters."""
    yield f"{name}: {kind.title}, {SCOPES[kind.scope]}"
    for paragraph in (getdoc(kind) or "").split("\n\n"):
        yield from ("", *_wrapped(paragraph, ""))
    yield from ("", "takes" if kind.takes else "takes no products")
    for port_name, port in kind.takes.items():
        yield from _wrapped(_port(port_name, port), "  ")
    yield from ("", f"gives {kind.gives}", "", "parameters")
    schema = kind.model_json_schema()
    own = [name for name in schema["properties"] if name not in ("stage", "keep")]
    followed = {parameter: port for port, names in kind.follows.items() for parameter in names}
    for parameter in (*own, "keep"):
        yield from _parameter_lines(parameter, schema, followed.get(parameter, ""))


def _parameter_lines(name: str, schema: Mapping[str, Any], followed: str) -> Iterator[str]:
    """followed : port whose stage has the default; "" for a default of its own"""
    own = schema["properties"][name]
    value = own.get("default")
    default = "required" if name in schema.get("required", ()) else _value(value)
    joint = ", in " if value is None or isinstance(value, str) else " "
    unit = f"{joint}{own['unit']}" if own.get("unit") else ""
    yield from _wrapped(f"{name}: " + (f"as in {followed}" if followed else f"{default}{unit}"), "  ")
    yield from _wrapped(allowed(own, schema.get("$defs", {})), "      ")
    yield from _wrapped(own.get("description", ""), "      ")


def _kinds(port: Port) -> str:
    optional = " (optional)" if port.optional else ""
    return " or ".join(port.kinds) + optional


def _port(name: str, port: Port) -> str:
    if port.own:
        return f"{name}: its own product, {_STEPS[port.at]}"
    several = "of one or several stages" if port.several else ""
    return " ".join(filter(None, [f"{name}: {_kinds(port)}", _STEPS[port.at], several]))


def _value(value: Any) -> str:
    """A default as a pipeline file has it."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False).replace('"', "")


def allowed(own: Mapping[str, Any], definitions: Mapping[str, Any]) -> str:
    """The values that a parameter takes."""
    if "$ref" in own:
        return allowed(definitions[own["$ref"].rpartition("/")[2]], definitions)
    if "anyOf" in own:
        forms = sorted(own["anyOf"], key=lambda form: form.get("type") != "null")
        return " or ".join(allowed(form, definitions) for form in forms)
    if "const" in own or "enum" in own:
        return " | ".join(_value(value) for value in own.get("enum", [own.get("const")]))
    if own.get("type") == "array":
        return _list(own, definitions)
    if own.get("type") == "object":
        return _mapping(own, definitions)
    limits = [words.format(own[key]) for key, words in _LIMITS.items() if key in own]
    return ", ".join([_TYPES.get(own.get("type", ""), "value") if not own.get("file") else "file", *limits])


def _list(own: Mapping[str, Any], definitions: Mapping[str, Any]) -> str:
    forms = dict.fromkeys(allowed(item, definitions) for item in own.get("prefixItems", [own.get("items", {})]))
    count = str(own["minItems"]) if own.get("minItems") == own.get("maxItems", ...) else "any number"
    return f"list of {count}: {' or '.join(forms)}"


def _mapping(own: Mapping[str, Any], definitions: Mapping[str, Any]) -> str:
    if "properties" in own:
        parts = (f"{name}: {allowed(part, definitions)}" for name, part in own["properties"].items())
        return f"mapping of {'; '.join(parts)}"
    return f"mapping of names to: {allowed(own.get('additionalProperties', {}), definitions)}"


def _wrapped(text: str, indent: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)
