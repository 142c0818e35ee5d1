"""RO-Crates (version 1.1): a folder with a description of what it holds, in JSON-LD.

::

    NAME.crate/  ro-crate-metadata.json
      files/       the pipeline file, and every file of the user that it reads, at their places
      store/       a store with one run

A crate may come from a stranger: :func:`read_crate` believes no path, and :func:`copy_file` no size and no digest.
"""

from __future__ import annotations

import hashlib
import json
import mimetypes
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote, unquote

from dicflow.engine.whole_file import open_file
from dicflow.errors import InputError
from dicflow.io.json_text import read_json

__all__ = [
    "FILES",
    "METADATA",
    "STORE",
    "Contents",
    "Crate",
    "Described",
    "copy_file",
    "is_plain",
    "read_crate",
    "refuse_link",
]

METADATA, FILES, STORE = "ro-crate-metadata.json", "files", "store"
_LARGEST = 1 << 26
_CHUNK = 1 << 20
_CONTEXT = ["https://w3id.org/ro/crate/1.1/context", {"sha256": "https://schema.org/sha256"}]
_DIGEST = re.compile("[0-9a-f]{64}")
_PART = re.compile(r'(?!\.)[^/\\:*?"<>|\x00-\x1f\x7f\ud800-\udfff]+')
"""A name that a file or folder can have on every system, and that is not hidden."""
_AGAIN = "get the crate again from where it was made"


class Contents(NamedTuple):
    """Size [bytes] and SHA-256 of a file."""

    size: int
    sha256: str


class Crate(NamedTuple):
    """What a crate says of itself. pipeline : path of the pipeline file; files : path below ``files`` → contents"""

    pipeline: str
    files: Mapping[str, Contents]


class Described(NamedTuple):
    """What the description of a crate is made of.

    title, methods : of the measurement, and how it was done, in sentences
    started : of the run [s since 1970]
    versions : package → the versions that took part
    """

    crate: Crate
    title: str
    methods: str
    run: str
    started: float
    versions: Mapping[str, Sequence[str]]

    def to_json(self) -> bytes:
        """The file with the description."""
        return json.dumps({"@context": _CONTEXT, "@graph": list(self._graph())}, ensure_ascii=False, indent=1).encode()

    def _graph(self) -> Iterator[dict[str, Any]]:
        version = {"@id": "https://w3id.org/ro/crate/1.1"}
        yield {"@id": METADATA, "@type": "CreativeWork", "conformsTo": version, "about": {"@id": "./"}}
        files = [_id(path) for path in self.crate.files]
        yield {
            "@id": "./",
            "@type": "Dataset",
            "name": self.title,
            "description": self.methods,
            "datePublished": _moment(time.time()),
            "license": "not stated; ask whoever made this crate",
            "hasPart": [*files, {"@id": f"{STORE}/"}],
            "mainEntity": _id(self.crate.pipeline),
            "mentions": {"@id": "#run"},
        }
        yield from (self._file(path, contents) for path, contents in self.crate.files.items())
        yield {"@id": f"{STORE}/", "@type": "Dataset", "name": "every product of the run, with its record"}
        yield from self._action(files)

    def _file(self, path: str, contents: Contents) -> dict[str, Any]:
        is_pipeline = path == self.crate.pipeline
        form = "text/yaml" if is_pipeline else mimetypes.guess_type(path)[0]
        return {
            **_id(path),
            "@type": ["File", "SoftwareSourceCode", "ComputationalWorkflow"] if is_pipeline else "File",
            "name": path,
            "contentSize": str(contents.size),
            "sha256": contents.sha256,
            **({"encodingFormat": form} if form else {}),
        }

    def _action(self, files: list[dict[str, str]]) -> Iterator[dict[str, Any]]:
        tools = [(f"#{name}", name, ", ".join(versions)) for name, versions in self.versions.items()]
        yield {
            "@id": "#run",
            "@type": "CreateAction",
            "name": f"run {self.run}",
            "startTime": _moment(self.started),
            "instrument": [{"@id": tool} for tool, *_ in tools],
            "object": files,
            "result": {"@id": f"{STORE}/"},
        }
        for tool, name, versions in tools:
            yield {"@id": tool, "@type": "SoftwareApplication", "name": name, "softwareVersion": versions}


def is_plain(path: str) -> bool:
    """Whether a path leads downwards alone, through names that are not hidden.

    >>> is_plain("left/a 1.png"), is_plain("../a.png"), is_plain("/etc/passwd"), is_plain(".dicflow/dicflow.json")
    (True, False, False, False)
    """
    return all(map(_PART.fullmatch, path.split("/")))


def read_crate(folder: Path) -> Crate:
    """What a crate of dicflow says of itself. Raises InputError."""
    path = folder / METADATA
    found = read_json(path, "the description of a crate", _LARGEST)
    try:
        entities = {entity["@id"]: entity for entity in found["@graph"]}
        files = dict(_listed(entities))
        pipeline = unquote(entities["./"]["mainEntity"]["@id"]).removeprefix(f"{FILES}/")
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            str(path), "does not describe a crate of dicflow", "name one that dicflow has written"
        ) from error
    if pipeline not in files or "/" in pipeline or not all(map(is_plain, files)):
        raise InputError(str(path), "names a file outside the crate, hidden, or not described", _AGAIN)
    return Crate(pipeline, files)


def copy_file(source: Path, target: Path, expected: Contents | None = None) -> Contents:
    """Copy a file, and return what was copied.

    expected : what it must be; no more than its size is read
    Raises InputError if it cannot be read, or is something else; OSError if the target cannot be written.
    """
    remedy = "get read access" if expected is None else _AGAIN
    try:
        reading = open_file(source, None if expected is None else expected.size)
    except OSError as error:
        raise InputError(str(source), f"cannot be read ({error.strerror})", remedy) from error
    digest, size = hashlib.sha256(), 0
    with reading, open(target, "xb") as writing:
        while chunk := reading.read(_CHUNK):
            writing.write(chunk)
            digest.update(chunk)
            size += len(chunk)
    found = Contents(size, digest.hexdigest())
    if expected is not None and found != expected:
        raise InputError(str(source), "is damaged (it does not fit its digest)", remedy)
    return found


def refuse_link(path: Path, root: Path) -> None:
    """Raise InputError if a path in a crate leads out of it."""
    if not path.resolve().is_relative_to(root.resolve()):
        raise InputError(str(path), "is a link out of the crate", _AGAIN)


def _listed(entities: Mapping[str, Any]) -> Iterator[tuple[str, Contents]]:
    """Path below ``files`` and contents of each file of a crate. Raises ValueError, KeyError, TypeError."""
    for part in entities["./"]["hasPart"]:
        entity = entities[part["@id"]]
        path = unquote(part["@id"])
        if path == f"{STORE}/":
            continue
        if not path.startswith(f"{FILES}/") or not _DIGEST.fullmatch(entity["sha256"]):
            raise ValueError(path)
        yield path.removeprefix(f"{FILES}/"), Contents(int(entity["contentSize"]), entity["sha256"])


def _id(path: str) -> dict[str, str]:
    return {"@id": quote(f"{FILES}/{path}")}


def _moment(seconds: float) -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(seconds))
