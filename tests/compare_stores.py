"""Compare the newest runs of two stores, task by task: ``python -m tests.compare_stores STORE_A STORE_B``.

Arrays are compared by the digests in the manifests; attributes by their values. The files are read as plain JSON and
not through dicflow, so the two stores may come from different releases. The exit code is 1 where a task or an array is
in one store alone or arrays differ, 0 where at most attributes differ, and 2 where a store cannot be read.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

__all__ = ["Contents", "Difference", "compare", "main", "newest_run", "read_store", "run_digests"]

Contents = Mapping[str, Mapping[str, Any]]
"""What each task came to: ``kind``, ``attrs`` and ``variables``, as in the manifest."""

_DESCRIPTION = ("dims", "units", "long_name")
"""Description of an array in a manifest, which the array's digest does not cover."""

_SHOWN = 3


class Difference(NamedTuple):
    """Something that is not the same for one task.

    what : "task", "array" or "attribute"
    how : "only in A", "only in B" or "differs"
    name : of the array or attribute; empty for a whole task
    """

    what: str
    how: str
    task: str
    name: str = ""


def newest_run(store: Path) -> Path:
    """The folder of the run that started last. Raises FileNotFoundError for a store without runs."""
    starts = {path.parent: json.loads(path.read_text())["started"] for path in store.glob("runs/*/pipeline.json")}
    if not starts:
        raise FileNotFoundError(f"{store}: no run in runs/")
    return max(starts, key=lambda run: (starts[run], run.name))


def run_digests(run: Path) -> dict[str, str]:
    """The digest of the product that each task of a run came to, from the run's index and its journal."""
    index = run / "index.json"
    entries = json.loads(index.read_text()) if index.exists() else {}
    entries.pop("crc32", None)  # the file's own check sum
    return {task: entry["digest"] for task, entry in entries.items()} | dict(_journal(run / "journal.jsonl"))


def _journal(path: Path) -> Iterator[tuple[str, str]]:
    """Task and digest of each finished event; a line cut short is left out."""
    for line in path.read_bytes().splitlines() if path.exists() else ():
        with suppress(ValueError):
            event = json.loads(line)
            if event.get("kind") == "finished" and event.get("digest"):
                yield event["task"], event["digest"]


def read_store(store: Path) -> dict[str, Mapping[str, Any]]:
    """Contents of the products of the newest run, by task. Raises OSError, ValueError and KeyError."""
    digests = run_digests(newest_run(store))
    if not digests:
        raise ValueError(f"{store}: the newest run holds no finished task")
    return {task: _content(store, digest) for task, digest in digests.items()}


def _content(store: Path, digest: str) -> Mapping[str, Any]:
    code = digest.partition(":")[2]
    return json.loads((store / "objects" / code[:2] / f"{code}.json").read_text())["content"]


def compare(a: Contents, b: Contents) -> list[Difference]:
    """All differences, in the order of tasks and names."""
    whole = [Difference("task", how, task) for task, how in _changes(dict.fromkeys(a), dict.fromkeys(b))]
    return whole + [found for task in sorted(a.keys() & b.keys()) for found in _product(task, a[task], b[task])]


def _product(task: str, a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[Difference]:
    for name, how in _changes(_arrays(a), _arrays(b)):
        yield Difference("array", how, task, name)
    shared = a["variables"].keys() & b["variables"].keys()
    for name, how in _changes(_attributes(a, shared), _attributes(b, shared)):
        yield Difference("attribute", how, task, name)


def _arrays(content: Mapping[str, Any]) -> dict[str, str]:
    return {name: variable["digest"] for name, variable in content["variables"].items()}


def _attributes(content: Mapping[str, Any], arrays: Collection[str]) -> dict[str, Any]:
    """The kind and the attributes by name, and ``array.units`` and the like of some arrays."""
    described = {f"{name}.{key}": content["variables"][name][key] for name in arrays for key in _DESCRIPTION}
    return {"(kind)": content["kind"], **content["attrs"], **described}


def _changes(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Names that are in one mapping alone or have different values, and how they differ."""
    for name in sorted(a.keys() | b.keys()):
        if name not in b:
            yield name, "only in A"
        elif name not in a:
            yield name, "only in B"
        elif a[name] != b[name]:
            yield name, "differs"


def _lines(differences: Sequence[Difference]) -> Iterator[str]:
    """One line for the differences of a stage's tasks that are alike."""
    groups: dict[tuple[str, str, str], list[str]] = {}
    for one in differences:
        stage = one.task.partition("/")[0]
        groups.setdefault((one.how, one.what, f"{stage}.{one.name}" if one.name else stage), []).append(one.task)
    for (how, what, name), tasks in groups.items():
        more = f" and {len(tasks) - _SHOWN} more" if len(tasks) > _SHOWN else ""
        yield f"{how}: {what} {name}; tasks: {', '.join(tasks[:_SHOWN])}{more}"


def main(arguments: Sequence[str]) -> int:
    """Print the differences; returns the exit code."""
    if len(arguments) != 2:
        print("usage: python -m tests.compare_stores STORE_A STORE_B", file=sys.stderr)
        return 2
    try:
        a, b = (read_store(Path(store)) for store in arguments)
    except (OSError, ValueError, KeyError) as error:
        print(f"cannot read a store: {error!r}", file=sys.stderr)
        return 2
    return _report(a, b)


def _report(a: Contents, b: Contents) -> int:
    found = compare(a, b)
    print(*_lines(found), sep="\n", end="\n" if found else "")
    for name, contents in (("A", a), ("B", b)):
        print(f"{name}: {len(contents)} tasks, {sum(len(one['variables']) for one in contents.values())} arrays")
    different = [one for one in found if one.what != "attribute"]
    print(f"{len(different)} tasks or arrays and {len(found) - len(different)} attributes differ")
    return int(bool(different))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
