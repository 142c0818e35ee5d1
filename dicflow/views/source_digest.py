"""Digest of the code that draws, so that an edit of it makes files again."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from dicflow._version import __version__

__all__ = ["source_digest"]


@cache
def source_digest(*layers: str) -> str:
    """Digest of this release and of all files of some layers, code and templates."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256(__version__.encode())
    for path in sorted(path for layer in layers for path in (package / layer).rglob("*") if path.is_file()):
        if path.suffix != ".pyc":
            digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()
