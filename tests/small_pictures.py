"""Pictures of screens for the manual, small enough for a repository."""

from __future__ import annotations

import io
from pathlib import Path

from PIL import Image

__all__ = ["MOST_BYTES", "keep"]

MOST_BYTES = 300_000
_COLOURS = (256, 128, 64)


def keep(content: bytes, path: Path, most_bytes: int = MOST_BYTES) -> None:
    """Write a PNG with all its colours, or with as many as fit. Raises ValueError where 64 do not."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with Image.open(io.BytesIO(content)) as picture:
        whole = picture.convert("RGB")
    for colours in (None, *_COLOURS):
        shown = whole if colours is None else whole.quantize(colours)
        shown.save(path, optimize=True)
        if path.stat().st_size <= most_bytes:
            print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB, {colours or 'all'} colours")
            return
    raise ValueError(f"{path}: more than {most_bytes} bytes; show less")
