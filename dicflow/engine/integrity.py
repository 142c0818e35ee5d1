"""Integrity of a stored product: its manifest and arrays against their digests."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

from dicflow.engine.hashing import digest_array
from dicflow.engine.objects import Manifest, descriptions, stored_array
from dicflow.engine.store import Store
from dicflow.engine.whole_file import NotRegularError, file_size, read_file
from dicflow.engine.zarr_files import is_described

__all__ = ["GONE", "check_group", "check_product", "reason_of"]

_CHUNK = re.compile(r"c(\.\d+)*")
GONE = (FileNotFoundError, NotADirectoryError, NotRegularError)
"""Errors of a file that is not there: nothing, or something else, has its name."""


def check_product(store: Store, digest: str) -> str:
    """The damage of a product as a message, "" if it is sound; all its files are read.

    Raises OSError if one of them cannot be read, StoreError if ``digest`` is not a digest.
    """
    path = store.manifest_path(digest)
    try:
        manifest = Manifest.read(path)
    except (*GONE, ValueError) as error:
        return f"{path}: {reason_of(error)}"
    if manifest.digest != digest:
        return f"{path}: belongs to another product"
    if not manifest.is_sound:
        return f"{path}: the content does not fit its digest"
    try:
        has_arrays = manifest.kept and manifest.content["variables"]
        return check_group(store.object_path(digest), manifest) if has_arrays else ""
    except GONE as error:
        return f"{error.filename}: {reason_of(error)}"


def reason_of(error: OSError | ValueError) -> str:
    """An error of reading as part of a message."""
    return (error.strerror or str(error)).lower() if isinstance(error, OSError) else str(error)


def check_group(folder: Path, manifest: Manifest) -> str:
    """The damage of the arrays of a product in a folder, "" if they are sound. Raises OSError as above."""
    damaged = [file for file, nbytes in manifest.files.items() if file_size(folder / file) != nbytes]
    if damaged:
        return f"{folder / damaged[0]}: is missing or has another size"
    for name, description in descriptions(manifest).items():
        if name in manifest.files and not is_described(read_file(folder / name), description):
            return f"{folder / name}: describes another array than was stored"
    strays = sorted(set(_chunks(folder, manifest)) - manifest.files.keys())
    if strays:
        return f"{folder / strays[0]}: is not part of the product"
    return _check_arrays(folder, manifest)


def _chunks(folder: Path, manifest: Manifest) -> Iterator[str]:
    """Files of the group that zarr takes for parts of an array."""
    for name in manifest.content["variables"]:
        yield from (f"{name}/{file}" for file in os.listdir(folder / name) if _CHUNK.fullmatch(file))


def _check_arrays(folder: Path, manifest: Manifest) -> str:
    for name, spec in manifest.content["variables"].items():
        try:
            digest = digest_array(stored_array(folder, manifest, name))
        except (OSError, MemoryError, ImportError):
            raise
        except Exception as error:
            return f"{folder / name}: cannot be unpacked ({error})"
        if digest != spec["digest"]:
            return f"{folder / name}: the values do not fit their digest"
    return ""
