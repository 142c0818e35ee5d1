"""Integrity of a stored product: its manifest and arrays against their digests."""

from __future__ import annotations

from pathlib import Path

from dicflow.engine.hashing import digest_array
from dicflow.engine.objects import Manifest, stored_array
from dicflow.engine.store import Store

__all__ = ["check_product"]


def check_product(store: Store, digest: str) -> str:
    """The damage of a product as a message, "" if it is sound; all its arrays are read.

    Raises StoreError if ``digest`` is not a digest.
    """
    folder, manifest = store.object_path(digest), store.manifest(digest)
    path = folder.with_suffix(".json")
    if manifest is None:
        return f"{path}: the manifest is missing, or belongs to another product"
    if not manifest.is_sound:
        return f"{path}: the manifest's content does not fit its digest"
    damaged = [file for file, nbytes in manifest.files.items() if _length(folder / file) != nbytes]
    if damaged:
        return f"{folder / damaged[0]}: is missing or has another size"
    return _check_arrays(folder, manifest) if manifest.kept else ""


def _check_arrays(folder: Path, manifest: Manifest) -> str:
    for name, spec in manifest.content["variables"].items():
        try:
            digest = digest_array(stored_array(folder, manifest, name))
        except Exception as error:
            return f"{folder / name}: cannot be read ({type(error).__name__})"
        if digest != spec["digest"]:
            return f"{folder / name}: the values do not fit their digest"
    return ""


def _length(path: Path) -> int | None:
    """Size of a file [bytes]; None if it is missing."""
    try:
        return path.stat().st_size
    except OSError:
        return None
