"""What is wrong with a stored product: its manifest and arrays held against their digests."""

from __future__ import annotations

from pathlib import Path

from dicflow.engine.hashing import digest_array
from dicflow.engine.objects import Manifest, stored_array
from dicflow.engine.store import Store

__all__ = ["fault"]


def fault(store: Store, digest: str) -> str:
    """What is wrong with a product, "" where nothing is; all its arrays are read.

    Raises StoreError for what is no digest.
    """
    folder, manifest = store.object_path(digest), store.manifest(digest)
    path = folder.with_suffix(".json")
    if manifest is None:
        return f"{path}: no manifest that fits its name"
    if not manifest.is_sound:
        return f"{path}: the manifest's content does not fit its digest"
    lacking = [file for file, nbytes in manifest.files.items() if _length(folder / file) != nbytes]
    if lacking:
        return f"{folder / lacking[0]}: is missing or has another size"
    return _array_fault(folder, manifest) if manifest.kept else ""


def _array_fault(folder: Path, manifest: Manifest) -> str:
    for name, spec in manifest.content["variables"].items():
        try:
            digest = digest_array(stored_array(folder, manifest, name))
        except Exception as error:
            return f"{folder / name}: cannot be read ({type(error).__name__})"
        if digest != spec["digest"]:
            return f"{folder / name}: the values do not fit their digest"
    return ""


def _length(path: Path) -> int | None:
    """Size of a file [bytes], None where it cannot be found."""
    try:
        return path.stat().st_size
    except OSError:
        return None
