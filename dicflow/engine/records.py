"""Records of what was done: one per key, with the parts of the key and what came out."""

from __future__ import annotations

import platform
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from dicflow.engine.hashing import digest_json, is_digest
from dicflow.engine.stored_json import anything, fields, is_number, is_text, list_of, mapping_of, read_stored, unseal

__all__ = ["Record", "sources", "versions"]


def _is_input(value: Any) -> bool:
    """Whether a value is a product's digest, or pairs (step, digest)."""
    return is_digest(value) or _is_series(value)


_is_series = list_of(lambda pair: isinstance(pair, list) and len(pair) == 2 and is_text(pair[0]) and is_digest(pair[1]))

_PARTS = {
    "stage": is_text,
    "impl_version": anything,
    "parameters": mapping_of(anything),
    "inputs": mapping_of(_is_input),
    "files": mapping_of(is_digest),
}
_MADE = {
    **dict.fromkeys(("task", "run", "time", "host"), is_text),
    **dict.fromkeys(("stage_s", "stage_cpu_s", "remake_s", "engine_s", "peak_bytes", "nbytes"), is_number),
    "versions": mapping_of(is_text),
    "warnings": list_of(is_text),
}
_RECORD = fields({
    "key": is_digest, "parts": fields(_PARTS), "digest": is_digest, "code": anything, "made": fields({}, _MADE),
})  # fmt: skip


@dataclass(frozen=True)
class Record:
    """What came out of one action.

    key : digest of the parts
    parts : stage, impl_version, parameters, inputs and files, see :mod:`dicflow.engine.keys`
    digest : of the product
    code : root of the fingerprint of the code that made it; "" where that has another form, made by other code
    made : provenance: task, run, time, host, seconds, peak memory, versions, warnings of the product
    """

    key: str
    parts: Mapping[str, Any]
    digest: str
    code: str
    made: Mapping[str, Any]

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings of the product."""
        return tuple(self.made.get("warnings", ()))

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
    def read(cls, path: Path) -> Record:
        """The record in a file. Raises OSError where it cannot be read, ValueError where it is damaged."""
        return cls._of(read_stored(path, _RECORD))

    @classmethod
    def parse(cls, content: bytes) -> Record:
        """The record in the contents of such a file. Raises ValueError where they are damaged."""
        return cls._of(unseal(content, _RECORD))

    @classmethod
    def _of(cls, value: Mapping[str, Any]) -> Record:
        code = value["code"] if is_digest(value["code"]) else ""
        return cls(value["key"], value["parts"], value["digest"], code, value["made"])


@cache
def versions() -> dict[str, str]:
    """Versions of Python, dicflow, and everything dicflow needs, as installed here."""
    from importlib.metadata import PackageNotFoundError, requires  # costs more than the rest of this module

    found = {"python": platform.python_version()}
    try:
        needs = requires("dicflow") or []
    except PackageNotFoundError:
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
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        found = distribution(name)
    except PackageNotFoundError:
        return "absent"
    stated = re.search(r"^Version: *(\S+)", found.read_text("METADATA") or "", re.MULTILINE)  # all of it takes longer
    return stated[1] if stated else found.version
