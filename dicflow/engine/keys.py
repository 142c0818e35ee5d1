"""Keys: names of actions, made from everything that the result depends on and from nothing else."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from dicflow.engine.graph import file_fields
from dicflow.engine.hashing import canonical_json, digest_bytes, digest_json
from dicflow.engine.node import Node
from dicflow.engine.references import Ref, RefInput

__all__ = ["Change", "differences", "input_digests", "key_maker", "key_of", "key_parts", "parameters", "shown"]


@dataclass(frozen=True)
class Change:
    """One difference from the last run. name : of the parameter, input, file or definition"""

    what: Literal["parameter", "input", "file", "code", "version", "record", "object", "stage"]
    name: str = ""
    old: Any = None
    new: Any = None

    @property
    def text(self) -> str:
        """The change as a text."""
        if self.what in ("parameter", "version"):
            return f"{self.name}: {shown(self.old)} → {shown(self.new)}"
        if self.what in ("input", "file"):
            verb = "is new" if self.old is None else "is no longer given" if self.new is None else "changed"
            return f"{self.what} {self.name} {verb}"
        if self.what == "code":
            return f"code of {self.name} changed" if self.name else "the code changed"
        return self.name


def parameters(node: Node) -> dict[str, Any]:
    """Parameters that affect the result as JSON, with defaults and units resolved; files count by their contents."""
    chosen = {name for name, field in type(node).model_fields.items() if _affects_result(field.json_schema_extra)}
    return node.model_dump(mode="json", include=chosen - file_fields(type(node)) - {"stage"})


def key_parts(
    node: Node, values: Mapping[str, Any], inputs: Mapping[str, Any], files: Mapping[str, str], is_look: bool = False
) -> dict[str, Any]:
    """Everything that the result of a task depends on.

    values : :func:`parameters` of the node
    inputs : :func:`input_digests`
    files : argument → digest of the file
    is_look : of a look of the stage at some steps
    """
    return {
        "stage": _action(node, is_look),
        "impl_version": node.impl_version,
        "parameters": values,
        "inputs": inputs,
        "files": dict(files),
    }


def input_digests(inputs: Mapping[str, RefInput]) -> dict[str, Any]:
    """Digests by port; for all steps pairs [step, digest], since such a stage sees the names of the steps."""
    found: dict[str, Any] = {}
    for port, source in inputs.items():
        if isinstance(source, Ref):
            found[port] = source.digest
        elif source is not None:
            found[port] = [[step, ref.digest] for step, ref in source]
    return found


def key_of(parts: Mapping[str, Any]) -> str:
    """The key: digest of its parts. Raises TypeError or ValueError for a parameter that JSON cannot express."""
    return digest_json(parts)


def key_maker(
    node: Node, values: Mapping[str, Any], is_look: bool = False
) -> Callable[[Mapping[str, Any], Mapping[str, str]], str]:
    """A function of the inputs and files of a task that gives its key, as :func:`key_of` its :func:`key_parts`.

    The part common to all tasks of a node is encoded once. values : :func:`parameters` of the node
    Raises TypeError or ValueError for a parameter that JSON cannot express.
    """
    version = canonical_json(node.impl_version)
    common = canonical_json({"parameters": values, "stage": _action(node, is_look)})[1:]

    def key(inputs: Mapping[str, Any], files: Mapping[str, str]) -> str:
        varying = canonical_json(files), version, canonical_json(inputs), common
        return digest_bytes(b'{"files":%b,"impl_version":%b,"inputs":%b,%b' % varying)

    return key


def _action(node: Node, is_look: bool) -> str:
    return f"{node.stage} look" if is_look else node.stage


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[Change]:
    """Differences between the parts of two keys: stage, version, parameters, files, inputs."""
    changes = []
    if old["stage"] != new["stage"]:
        changes.append(Change("stage", f"stage: {old['stage']} → {new['stage']}"))
    if old["impl_version"] != new["impl_version"]:
        changes.append(Change("version", "impl_version", old["impl_version"], new["impl_version"]))
    changes += [Change("parameter", *change) for change in _leaves(old["parameters"], new["parameters"])]
    for what, part in (("file", "files"), ("input", "inputs")):
        for name in {**old[part], **new[part]}:
            before, after = old[part].get(name), new[part].get(name)
            if before != after:
                changes.append(Change("file" if what == "file" else "input", name, before, after))
    return changes


def _leaves(old: Any, new: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """The innermost values that differ, with dotted names."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in {**old, **new}:
            yield from _leaves(old.get(key), new.get(key), f"{name}.{key}" if name else key)
    elif old != new:
        yield name, old, new


def _affects_result(extra: Any) -> bool:
    return not isinstance(extra, dict) or extra.get("affects", "result") == "result"


def shown(value: Any) -> str:
    """A value of a parameter as a text that is not too long."""
    text = "none" if value is None else str(value)
    return text if len(text) <= 60 else f"{text[:57]}…"
