"""What the app keeps beside the pipeline file, so that it need not be made again: the last used of it."""

from __future__ import annotations

import os
import re
import shutil
import time
from contextlib import suppress
from pathlib import Path

__all__ = ["keep_newest"]

_KEY = re.compile(r"[0-9a-f]{32}(\.jpg)?")


def keep_newest(used: Path, most: int) -> None:
    """Mark a file or folder, named by a key, as used now, and delete those beside it that were not used for longest.

    most : how many stay
    """
    with suppress(OSError):
        os.utime(used, ns=(time.time_ns(),) * 2)  # finer than the system's own time of files
    found = []
    for entry in os.scandir(used.parent):
        if _KEY.fullmatch(entry.name):
            with suppress(OSError):  # deleted by another process
                found.append((entry.stat().st_mtime_ns, entry.path))
    for _, path in sorted(found)[: -most or None]:
        _delete(Path(path))


def _delete(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
