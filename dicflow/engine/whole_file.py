"""Writing a file as a whole."""

from __future__ import annotations

import os
import uuid
from contextlib import suppress
from pathlib import Path

__all__ = ["write_file"]


def write_file(path: Path, content: bytes, draft: Path | None = None) -> None:
    """Write a file, or replace it. No process ever reads half of it, and a killed one leaves only the draft.

    draft : where the content is written before it is renamed, on the same file system; beside the file by default
    Raises OSError. An existing file is then left untouched, and the draft is deleted.
    """
    draft = draft or path.with_name(f"{path.name}.{os.getpid()}-{uuid.uuid4().hex[:8]}.part")
    try:
        draft.write_bytes(content)
        os.replace(draft, path)
    except BaseException:
        with suppress(OSError):
            draft.unlink(missing_ok=True)
        raise
