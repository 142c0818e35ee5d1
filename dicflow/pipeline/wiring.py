"""From what a pipeline file says to validated stages with their inputs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from pydantic import ValidationError

from dicflow.discovery import nearest
from dicflow.engine.node import Node, Port, numbered_port, port_of
from dicflow.errors import ConfigurationError
from dicflow.io.configuration import Document, Place
from dicflow.pipeline.complaints import complaints
from dicflow.pipeline.registry import node_class
from dicflow.pipeline.report_facts import check_report_facts

__all__ = ["FORMAT", "Wired", "wire"]

FORMAT = 1
"""Version of the pipeline file that this release reads."""

_TOP = ("dicflow", "title", "report", "stages", "sweep")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_MAX_STAGES = 100


class Wired(NamedTuple):
    """One stage of a pipeline.

    node : its validated parameters
    inputs : port → name of the stage that gives it, as :class:`dicflow.engine.graph.StageSpec` has them; a port left
        open is absent
    where : ``file:line:column`` of the stage
    places : parameter → the same of what the file gives for it
    """

    node: Node
    inputs: dict[str, str]
    where: str
    places: Mapping[str, str]


def wire(document: Document) -> dict[str, Wired]:
    """Validate every stage and find every input.

    Raises ConfigurationError that lists all problems, one line each with its place.
    """
    problems: list[str] = []
    stages = _stages(document, problems)
    check_report_facts(document, problems)
    nodes = {name: node for name, entry in stages.items() if (node := _node(document, name, entry, problems))}
    wired = {
        name: Wired(
            node,
            _inputs(document, name, stages[name], nodes, problems),
            document.where(("stages", name)),
            {key: document.where(("stages", name, key)) for key in stages[name]},
        )
        for name, node in nodes.items()
    }
    if not problems:
        _refuse_cycles(document, wired, problems)
    if problems:
        raise ConfigurationError("\n".join(problems))
    return {name: stage._replace(node=_with_followed(stage, wired)) for name, stage in wired.items()}


def _with_followed(stage: Wired, wired: Mapping[str, Wired]) -> Node:
    """The node with parameters that are not given taken from the stages that it follows."""
    followed = {
        name: getattr(wired[stage.inputs[port]].node, name)
        for port, names in stage.node.follows.items()
        if port in stage.inputs
        for name in names
        if name not in stage.node.model_fields_set
    }
    return stage.node.model_copy(update=followed) if followed else stage.node


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
        problems.append(
            f"{document.where(('stages',))}: 'stages:' must map names to stages; 'dicflow init' writes such a file"
        )
        return {}
    if len(stages) > _MAX_STAGES:
        where = document.where(("stages",))
        problems.append(f"{where}: {len(stages):,} stages, at most {_MAX_STAGES} are possible; write fewer")
        return {}
    return {name: entry for name, entry in stages.items() if _is_entry(document, name, entry, problems)}


def _is_entry(document: Document, name: str, entry: Any, problems: list[str]) -> bool:
    where = document.where(("stages", name))
    if not _NAME.fullmatch(name):
        problems.append(f"{where}: '{name}' is not a name for a stage; use letters, digits and _")
    elif not isinstance(entry, dict) or not isinstance(entry.get("stage"), str):
        problems.append(f"{where}: {name}: expected a mapping; say which stage it is, with 'stage: …'")
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
        problems += complaints(document, place, kind, error, (*kind.model_fields, *kind.takes)[1:])
        return None


def _inputs(
    document: Document, name: str, entry: Mapping[str, Any], nodes: Mapping[str, Node], problems: list[str]
) -> dict[str, str]:
    """Port → stage for every input that is named or can be only one.

    A stage that takes a product and gives one of the same kind, as a refined rig, stands for it in all other stages.
    ``cloud_before``, ``cloud_first`` and ``cloud_early`` are by default joined to the stage of ``cloud``, and a port of
    another one to what that one's stage takes.
    """
    takes, found = nodes[name].takes, dict[str, str]()
    for port_name, port in takes.items():
        same = port_name.removesuffix("_before").removesuffix("_first").removesuffix("_early")
        if not nodes[name].joins(port_name):
            if entry.get(port_name) is not None:
                where = document.where(("stages", name, port_name))
                problems.append(f"{where}: {name}.{port_name}: not used with these parameters; remove it")
            continue
        if port.several:
            found |= _producers(document, name, port_name, port, nodes, problems)
            continue
        if port.own:
            producer: str | None = name
        elif same != port_name and same in takes and port_name not in entry:
            producer = found.get(same)
        elif port.of and port_name not in entry:
            producer = _taken(document, found.get(port.of), port_name, nodes)
        else:
            producer = _producer(document, name, port_name, port, entry, nodes, problems)
        if producer is not None:
            found[port_name] = producer
    return found


def _producers(
    document: Document, name: str, port_name: str, port: Port, nodes: Mapping[str, Node], problems: list[str]
) -> dict[str, str]:
    """The stages joined to a port that takes several: those of a list or a single one, else all that fit."""
    entry, fitting = document.data["stages"][name], [other for other, node in nodes.items() if node.gives in port.kinds]
    if port_name not in entry:
        producers = [other for other in fitting if other != name]
    else:
        listed = entry[port_name] if isinstance(entry[port_name], list) else [entry[port_name]]
        given = [_producer(document, name, port_name, port, {port_name: one}, nodes, problems) for one in listed]
        producers = [one for one in given if one is not None]
    if not producers and not port.optional and port_name not in entry:
        where, kinds = document.where(("stages", name, port_name)), " or ".join(port.kinds)
        problems.append(f"{where}: {name}.{port_name}: needs {kinds}; {_suggestion([], kinds)}")
    return {numbered_port(port_name, number): producer for number, producer in enumerate(producers)}


def _taken(document: Document, stage: str | None, port_name: str, nodes: Mapping[str, Node]) -> str | None:
    """What a stage takes at a port; None for no stage, or one without that port."""
    if stage is None or (port := nodes[stage].takes.get(port_name)) is None:
        return None
    return _producer(document, stage, port_name, port, document.data["stages"][stage], nodes, [])


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
    kinds = " or ".join(port.kinds)
    if port_name in entry:
        given = entry[port_name]
        if given in fitting or (given is None and port.optional):
            return None if given is None else str(given)
        if not isinstance(given, str):
            problem = f"expected the name of one stage, found {'null' if given is None else repr(given)}"
        elif given == name:
            problem = "takes its own product"
        elif given in nodes:
            problem = f"'{given}' gives {nodes[given].gives}, not {kinds}"
        elif given in document.data["stages"]:
            return None  # that stage is reported at its own place
        else:
            problem = f"no stage '{given}'{nearest(given, nodes)}"
        problems.append(f"{where}: {name}.{port_name}: {problem}; {_suggestion(fitting, kinds)}")
    elif len(last := _last_of_chain(document, fitting, nodes)) == 1:
        return last[0]
    elif fitting or (not port.optional and len(nodes) == len(document.data["stages"])):
        none = ", or null for none" if port.optional else ""
        problems.append(f"{where}: {name}.{port_name}: needs {kinds}; {_suggestion(fitting, kinds)}{none}")
    return None


def _last_of_chain(document: Document, fitting: list[str], nodes: Mapping[str, Node]) -> list[str]:
    """The stages whose product no other of them takes to give one of the same kind."""
    replaced = {source for name in fitting for source in _replaced(document, name, nodes)}
    return [name for name in fitting if name not in replaced]


def _replaced(document: Document, name: str, nodes: Mapping[str, Node]) -> list[str]:
    """The stages whose products a stage takes to give one of the same kind: those that it names, or the only one."""
    kind, entry = nodes[name].gives, document.data["stages"][name]
    ports = [port_name for port_name, port in nodes[name].takes.items() if kind in port.kinds and not port.own]
    named = [entry[port_name] for port_name in ports if isinstance(entry.get(port_name), str)]
    others = [other for other, node in nodes.items() if node.gives == kind and other != name]
    return named or (others if ports and len(others) == 1 else [])


def _suggestion(fitting: list[str], kinds: str) -> str:
    return f"name one of {', '.join(fitting)}" if fitting else f"add a stage that gives {kinds}"


def _refuse_cycles(document: Document, wired: Mapping[str, Wired], problems: list[str]) -> None:
    """Report stages that wait for each other; a stage may take its own product of another step."""
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        if name in trail:
            ring = " → ".join((*trail[trail.index(name) :], name))
            problems.append(f"{wired[name].where}: the stages {ring} wait for each other; change one input")
            done.update(trail)
        if name in done:
            return
        for port, producer in wired[name].inputs.items():
            if not wired[name].node.takes[port_of(port)].own:
                visit(producer, (*trail, name))
        done.add(name)

    for name in wired:
        visit(name, ())
