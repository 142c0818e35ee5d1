"""Digests: names for values by their contents, ``"sha256:…"``.

Only values enter a digest, never the way or the place in which they are kept, so equal contents have equal digests on
every machine.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dicflow.engine.whole_file import open_file

if TYPE_CHECKING:
    import numpy as np

__all__ = ["canonical_json", "digest_array", "digest_bytes", "digest_file", "digest_json", "is_digest", "plain"]

_DIGEST = re.compile(r"sha256:[0-9a-f]{64}")
_KINDS = "biuf"
"""Kinds of dtype that have one meaning everywhere: booleans, integers, floats."""
_CANONICAL = json.JSONEncoder(sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def is_digest(text: object) -> bool:
    """Whether a text has the form of a digest; only a digest may become part of a path in a store."""
    return isinstance(text, str) and _DIGEST.fullmatch(text) is not None


def canonical_json(value: Any) -> bytes:
    """JSON in one form per value: sorted keys, no spaces, shortest numbers, UTF-8.

    Raises TypeError for a value that JSON cannot express and ValueError for NaN and infinities.
    """
    return _CANONICAL.encode(value).encode("utf-8")


def digest_json(value: Any) -> str:
    """Digest of a JSON value. Raises as :func:`canonical_json` does."""
    return digest_bytes(canonical_json(value))


def digest_bytes(content: bytes) -> str:
    """Digest of bytes."""
    return _name(hashlib.sha256(content))


def digest_array(array: np.ndarray) -> str:
    """Digest of an array: dtype, shape, and its values in C order as little-endian bytes.

    array : any shape, booleans, integers or floats
    Raises TypeError for any other dtype.
    """
    import numpy as np

    if array.dtype.kind not in _KINDS:
        raise TypeError(f"an array of {array.dtype} has no digest; arrays must be numbers or booleans")
    little = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    state = hashlib.sha256(canonical_json([array.dtype.newbyteorder("<").str, list(array.shape)]))
    state.update(little.reshape(-1).view(np.uint8).data)
    return _name(state)


def digest_file(path: Path) -> str:
    """Digest of a file's bytes. Raises OSError, also for what is not a regular file."""
    with open_file(path) as file:
        return _name(hashlib.file_digest(file, "sha256"))


def plain(value: Any) -> Any:
    """A value in JSON's own types: tuples become lists, numpy's scalars numbers, NaN and infinities None.

    Raises TypeError for a value that JSON cannot express, such as an array.
    """
    if isinstance(value, Mapping):
        return {_text(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, str):
        return str(value)
    if hasattr(value, "dtype") and getattr(value, "shape", None) == ():
        return plain(value.item())
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, int):
        return int(value)
    raise TypeError(f"{type(value).__name__} is not a JSON value")


def _text(key: Any) -> str:
    if not isinstance(key, str):
        raise TypeError(f"mapping keys must be strings, got {key!r}")
    return str(key)


def _name(state: hashlib._Hash) -> str:
    return f"{state.name}:{state.hexdigest()}"
