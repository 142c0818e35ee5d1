"""The pages of the stages, made from the nodes: what each does, takes, gives, its parameters, an example."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from inspect import getdoc
from pathlib import Path
from typing import Any

import yaml

from dicflow.engine.node import At, Node, Port
from dicflow.pipeline.registry import node_class, stage_names
from dicflow.pipeline.stage_words import SCOPES, allowed
from tests.manual.kinds import kind_sentence

__all__ = ["example_of", "stage_pages"]

_PIPELINES = Path(__file__).parents[2] / "pipelines"
_STEPS = {
    At.SAME: "the same",
    At.PREVIOUS: "the previous one",
    At.FIRST: "the first",
    At.ALL: "all",
    At.EARLY: "a few early ones",
}
_EFFECTS = {"result": "", "speed": " (never changes the result)", "report": " (changes the report alone)"}
_EXAMPLES: Mapping[str, Mapping[str, Any]] = {
    "frame": {"axes": {"stage": "frame", "method": "three_points", "places": [[320, 440], [400, 440], [320, 140]]}},
    "noise_floor": {"noise": {"stage": "noise_floor", "still": ["step_01", "step_02"]}},
    "refine": {"refined": {"stage": "refine", "images": "photos", "rig": "rig"}},
    "virtual_fields": {
        "constants": {"stage": "virtual_fields", "width": "60 mm", "thickness": "1 mm", "u_thickness": "0.02 mm"}
    },
}
"""Of the stages that no file in ``pipelines`` uses."""


@cache
def stage_pages() -> dict[str, str]:
    """Path below ``docs`` → text, the page of all stages first."""
    pages = {f"reference/stages/{name}.md": "\n".join(_page(name, node_class(name))) for name in stage_names()}
    return {"reference/stages.md": "\n".join(_overview()), **pages}


@cache
def example_of(name: str) -> Mapping[str, Mapping[str, Any]]:
    """A stage of a pipeline file: its name there → its entry."""
    used = (
        {key: entry}
        for path in sorted(_PIPELINES.glob("*.yaml"), key=lambda path: (path.stem != "quickstart", path.stem))
        for key, entry in yaml.safe_load(path.read_text(encoding="utf-8"))["stages"].items()
        if entry["stage"] == name
    )
    return next(used, None) or _EXAMPLES[name]


def _overview() -> Iterator[str]:
    yield from ("# Stages", "", "Made from the program itself, as `dicflow stages` prints it.", "")
    yield from ("| stage | does | runs | takes | gives |", "|---|---|---|---|---|")
    for name in stage_names():
        kind = node_class(name)
        takes = ", ".join(dict.fromkeys(" or ".join(port.kinds) for port in kind.takes.values() if not port.own))
        yield f"| [`{name}`](stages/{name}.md) | {kind.title} | {SCOPES[kind.scope]} | {takes} | {kind.gives} |"


def _page(name: str, kind: type[Node]) -> Iterator[str]:
    yield from (f"# {name}", "", f"*{kind.title}, {SCOPES[kind.scope]}*", "")
    yield from (_markdown(getdoc(kind) or ""), "", "## Example", "", "```yaml", _example_text(name), "```", "")
    yield from ("## Inputs", "")
    yield from _inputs(kind) if kind.takes else ["None: it reads files.", ""]
    yield from ("## Product", "", f"`{kind.gives}`: {kind_sentence(kind.gives)}", "", "## Parameters", "")
    yield from _parameters(kind)


def _example_text(name: str) -> str:
    (key, entry), *_ = example_of(name).items()
    inline = yaml.safe_dump(dict(entry), default_flow_style=True, sort_keys=False, width=10_000, allow_unicode=True)
    return f"{key}: {inline.strip()}"


def _inputs(kind: type[Node]) -> Iterator[str]:
    yield from ("| input | kind of product | of which step | |", "|---|---|---|---|")
    for name, port in kind.takes.items():
        yield f"| `{name}` | {' or '.join(port.kinds) or kind.gives} | {_STEPS[port.at]} | {_port_note(port)} |"
    yield ""


def _port_note(port: Port) -> str:
    notes = {"its own product": port.own, "optional": port.optional, "one or several stages": port.several}
    return ", ".join(note for note, holds in notes.items() if holds)


def _parameters(kind: type[Node]) -> Iterator[str]:
    schema = kind.model_json_schema()
    followed = {parameter: port for port, names in kind.follows.items() for parameter in names}
    yield from ("| parameter | default | values | meaning |", "|---|---|---|---|")
    own_first = sorted(schema["properties"].items(), key=lambda one: one[0] == "keep")
    for name, own in own_first:
        if name != "stage":
            default = f"as in `{followed[name]}`" if name in followed else _default(name, own, schema)
            values, meaning = _cell(allowed(own, schema.get("$defs", {}))), _cell(own.get("description", ""))
            unit, effect = own.get("unit", ""), _EFFECTS[own.get("affects", "result")]
            yield f"| `{name}` | {default} | {values}{f' [{unit}]' if unit else ''} | {meaning}{effect} |"


def _default(name: str, own: Mapping[str, Any], schema: Mapping[str, Any]) -> str:
    if name in schema.get("required", ()):
        return "required"
    value = own.get("default")
    text = "none" if value is None else yaml.safe_dump(value, default_flow_style=True, width=10_000, allow_unicode=True)
    return f"`{_cell(text.removesuffix('...' + chr(10)).strip())}`"


def _cell(text: str) -> str:
    return _markdown(text).replace("|", "\\|").replace("\n", " ")


def _markdown(text: str) -> str:
    """Docstring to Markdown: double backticks become single ones."""
    return text.replace("``", "`")
