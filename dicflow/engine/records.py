"""Records of what was done: one per key, with the parts of the key and what came out."""

from __future__ import annotations

import importlib.metadata
import platform
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from dicflow.engine.hashing import digest_json, is_digest

__all__ = ["Record", "sources", "versions"]


@dataclass(frozen=True)
class Record:
    """What came out of one action.

    key : digest of the parts
    parts : stage, impl_version, parameters, inputs and files, see :mod:`dicflow.engine.keys`
    digest : of the product
    code : root of the fingerprint of the code that made it; "" where that has another form, made by other code
    made : provenance: task, run, time, host, seconds, peak memory, versions
    """

    key: str
    parts: Mapping[str, Any]
    digest: str
    code: str
    made: Mapping[str, Any]

    def to_json(self) -> dict[str, Any]:
        """The record as JSON."""
        return {
            "key": self.key,
            "parts": self.parts,
            "digest": self.digest,
            "code": self.code,
            "made": dict(self.made),
        }

    @classmethod
    def from_json(cls, value: Any) -> Record | None:
        """The record, or None where the JSON is not a record."""
        try:
            code = value["code"] if is_digest(value["code"]) else ""
            loaded = cls(value["key"], value["parts"], value["digest"], code, value["made"])
        except (TypeError, KeyError):
            return None
        return loaded if is_digest(loaded.key) and is_digest(loaded.digest) else None


@cache
def versions() -> dict[str, str]:
    """Versions of Python, dicflow, and everything dicflow needs, as installed here."""
    found = {"python": platform.python_version()}
    try:
        needs = importlib.metadata.requires("dicflow") or []
    except importlib.metadata.PackageNotFoundError:
        return found
    for line in ["dicflow", "distributed", *(need for need in needs if "extra ==" not in need)]:
        match = re.match(r"[A-Za-z0-9._-]+", line)
        if match is not None:
            found[match[0]] = _version(match[0])
    return found


def sources() -> str:
    """Digest of the text of all modules of dicflow that are installed here."""
    package = Path(__file__).parents[1]
    texts = {path.relative_to(package).as_posix(): path.read_text("utf-8") for path in package.rglob("*.py")}
    return digest_json(texts)


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "absent"
