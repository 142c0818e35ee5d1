"""The stages by name: those of :mod:`dicflow.stages`, and those of other packages in the group ``dicflow.stages``."""

from __future__ import annotations

import inspect
from functools import cache
from types import ModuleType

from dicflow.discovery import Member, Registry
from dicflow.engine.node import Node
from dicflow.errors import ConfigurationError

__all__ = ["node_class", "node_classes", "stage_names"]

_STAGES = Registry("stage", "dicflow.stages", "dicflow.stages")


def stage_names() -> tuple[str, ...]:
    """Names of all stages, sorted."""
    return _STAGES.names()


@cache
def node_class(name: str) -> type[Node]:
    """The node of a stage.

    Raises ConfigurationError that suggests the nearest name for an unknown one, and for a plug-in that is not a stage.
    """
    member, loaded = _STAGES.find(name), _STAGES.load(name)
    kind = getattr(loaded, _first_public(loaded), None) if isinstance(loaded, ModuleType) else loaded
    if not (isinstance(kind, type) and issubclass(kind, Node)):
        raise ConfigurationError(
            f"stage '{name}' of {member.place} is not a Node; name its class: package.module:Class"
        )
    _check_name(member, kind)
    _check_declaration(member, kind)
    return kind


def node_classes() -> tuple[dict[str, type[Node]], list[str]]:
    """All usable stages by name, and a message for each plug-in that cannot be used."""
    found: dict[str, type[Node]] = {}
    problems: list[str] = []
    for name in stage_names():
        try:
            found[name] = node_class(name)
        except ConfigurationError as error:
            problems.append(str(error))
    return found, problems


def _first_public(module: ModuleType) -> str:
    return str(next(iter(getattr(module, "__all__", ())), ""))


def _check_name(member: Member, kind: type[Node]) -> None:
    """Raise ConfigurationError if the class has another stage name than its registration."""
    field = kind.model_fields["stage"]
    if field.default != member.name:
        calls = "has no name of its own" if field.is_required() else f"calls itself {field.default!r}"
        raise ConfigurationError(
            f"stage '{member.name}' of {member.place} {calls}; "
            f'declare stage: Literal["{member.name}"] = "{member.name}"'
        )


def _check_declaration(member: Member, kind: type[Node]) -> None:
    """Raise ConfigurationError if the class lacks what every stage declares."""
    missing = [name for name in ("title", "scope", "gives") if not hasattr(kind, name)]
    if missing:
        raise ConfigurationError(
            f"stage '{member.name}' of {member.place} lacks {', '.join(missing)}; declare each as a ClassVar"
        )
    arguments = inspect.signature(kind.run).parameters
    takes_any = any(one.kind is inspect.Parameter.VAR_KEYWORD for one in arguments.values())
    unknown = [] if takes_any else [port for port in kind.takes if port not in arguments]
    if unknown:
        raise ConfigurationError(
            f"stage '{member.name}' of {member.place} takes {', '.join(unknown)}, but run has no such argument; "
            "name the arguments of run as the inputs"
        )
