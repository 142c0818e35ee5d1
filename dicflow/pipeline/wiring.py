"""From what a pipeline file says to validated stages with their inputs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from pydantic import ValidationError

from dicflow.engine.node import Node, Port
from dicflow.errors import ConfigurationError
from dicflow.io.configuration import Document, Place
from dicflow.pipeline.registry import nearest, node_class

__all__ = ["FORMAT", "Wired", "wire"]

FORMAT = 1
"""Version of the pipeline file that this release reads."""

_TOP = ("dicflow", "title", "stages", "sweep")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class Wired(NamedTuple):
    """One stage of a pipeline.

    node : its validated parameters
    inputs : port → name of the stage that gives it; a port left open is absent
    where : ``file:line:column`` of the stage
    """

    node: Node
    inputs: dict[str, str]
    where: str


def wire(document: Document) -> dict[str, Wired]:
    """Validate every stage and find every input.

    Raises ConfigurationError that lists all that is wrong, one line each with its place.
    """
    problems: list[str] = []
    stages = _stages(document, problems)
    nodes = {name: node for name, entry in stages.items() if (node := _node(document, name, entry, problems))}
    wired = {
        name: Wired(node, _inputs(document, name, stages[name], nodes, problems), document.where(("stages", name)))
        for name, node in nodes.items()
    }
    if not problems:
        _refuse_cycles(document, wired, problems)
    if problems:
        raise ConfigurationError("\n".join(problems))
    return wired


def _stages(document: Document, problems: list[str]) -> dict[str, dict[str, Any]]:
    """The entries under ``stages`` that are mappings with a stage's name."""
    data = document.data
    for key in data:
        if key not in _TOP:
            problems.append(
                f"{document.where((key,))}: unknown key '{key}'{nearest(key, _TOP)}; keys: {', '.join(_TOP)}"
            )
    if data.get("dicflow", FORMAT) != FORMAT:
        problems.append(
            f"{document.where(('dicflow',))}: this release reads format {FORMAT}, the file says {data['dicflow']!r}; "
            "use a release that fits"
        )
    stages = data.get("stages")
    if not isinstance(stages, dict) or not stages:
        problems.append(f"{document.where(('stages',))}: 'stages:' must map names to stages")
        return {}
    return {name: entry for name, entry in stages.items() if _is_entry(document, name, entry, problems)}


def _is_entry(document: Document, name: str, entry: Any, problems: list[str]) -> bool:
    where = document.where(("stages", name))
    if not _NAME.fullmatch(name):
        problems.append(f"{where}: '{name}' is no name for a stage; use letters, digits and _")
    elif not isinstance(entry, dict) or not isinstance(entry.get("stage"), str):
        problems.append(f"{where}: {name}: expected a mapping with 'stage: …' that says which stage it is")
    else:
        return True
    return False


def _node(document: Document, name: str, entry: Mapping[str, Any], problems: list[str]) -> Node | None:
    place: Place = ("stages", name)
    try:
        kind = node_class(entry["stage"])
    except ConfigurationError as error:
        problems.append(f"{document.where((*place, 'stage'))}: {name}: {error}")
        return None
    try:
        return kind.model_validate({key: value for key, value in entry.items() if key not in kind.takes})
    except ValidationError as error:
        for detail in error.errors():
            problems.append(_complaint(document, place, kind, dict(detail)))
        return None


def _complaint(document: Document, place: Place, kind: type[Node], detail: Mapping[str, Any]) -> str:
    """One line for one of pydantic's errors."""
    known = [*kind.model_fields, *kind.takes]
    path = _path(document, place, detail["loc"])
    where = document.where((*place, *path))
    dotted = ".".join(str(part) for part in (place[-1], *(path or detail["loc"])))
    if detail["type"] == "extra_forbidden":
        word = str(detail["loc"][-1])
        return f"{where}: {dotted}: unknown parameter{nearest(word, known)}; it takes {', '.join(known[1:])}"
    if detail["type"] == "missing":
        description = kind.model_fields[str(detail["loc"][0])].description if len(detail["loc"]) == 1 else ""
        return f"{where}: {dotted}: is missing; give {description or 'a value'}"
    message = re.sub(r"^Value error, ", "", detail["msg"])
    return f"{where}: {dotted}: {message[:1].lower() + message[1:]}, found {detail['input']!r}"


def _path(document: Document, place: Place, location: tuple[str | int, ...]) -> Place:
    """The part of an error's location that stands in the file; tags of unions do not."""
    path: Place = ()
    for part in location:
        if (*place, *path, part) in document.positions:
            path = (*path, part)
    return path


def _inputs(
    document: Document, name: str, entry: Mapping[str, Any], nodes: Mapping[str, Node], problems: list[str]
) -> dict[str, str]:
    """Port → stage for every input that is named or can be only one; ``cloud_before`` is what ``cloud`` is by default."""
    found: dict[str, str] = {}
    for port_name, port in nodes[name].takes.items():
        same = found.get(port_name.removesuffix("_before")) if port_name not in entry else None
        producer = name if port.own else same or _producer(document, name, port_name, port, entry, nodes, problems)
        if producer is not None:
            found[port_name] = producer
    return found


def _producer(
    document: Document,
    name: str,
    port_name: str,
    port: Port,
    entry: Mapping[str, Any],
    nodes: Mapping[str, Node],
    problems: list[str],
) -> str | None:
    where = document.where(("stages", name, port_name))
    fitting = [other for other, node in nodes.items() if node.gives in port.kinds and other != name]
    wanted = " or ".join(port.kinds)
    if port_name in entry:
        given = entry[port_name]
        if given in fitting or (given is None and port.optional):
            return None if given is None else str(given)
        if given in nodes:
            said = f"'{given}' gives {nodes[given].gives}, not {wanted}"
        elif isinstance(given, str) and given in document.data["stages"]:
            return None  # the fault of that stage is told at its own place
        else:
            said = f"no stage '{given}'{nearest(str(given), nodes)}"
        problems.append(f"{where}: {name}.{port_name}: {said}; {_offer(fitting, wanted)}")
    elif len(fitting) == 1:
        return fitting[0]
    elif fitting or (not port.optional and len(nodes) == len(document.data["stages"])):
        none = ", or null for none" if port.optional else ""
        problems.append(f"{where}: {name}.{port_name}: needs {wanted}; {_offer(fitting, wanted)}{none}")
    return None


def _offer(fitting: list[str], wanted: str) -> str:
    return f"name one of {', '.join(fitting)}" if fitting else f"add a stage that gives {wanted}"


def _refuse_cycles(document: Document, wired: Mapping[str, Wired], problems: list[str]) -> None:
    """A stage may take its own output of another step, and no other way round."""
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        if name in trail:
            ring = " → ".join((*trail[trail.index(name) :], name))
            problems.append(f"{wired[name].where}: the stages {ring} wait for each other; change one input")
            done.update(trail)
        if name in done:
            return
        for port, producer in wired[name].inputs.items():
            if not wired[name].node.takes[port].own:
                visit(producer, (*trail, name))
        done.add(name)

    for name in wired:
        visit(name, ())
