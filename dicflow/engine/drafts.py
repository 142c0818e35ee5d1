"""Names of drafts: files and folders that are being written, and get their real names when they are whole.

A draft's name says which process of which machine writes it, so that the remains of a killed process
differ from what another one is writing at this moment::

    <machine>-<process>-<random>
"""

from __future__ import annotations

import hashlib
import math
import os
import platform
import re
import time
import uuid
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

__all__ = ["DRAFT", "draft_name", "is_abandoned", "tree"]

DRAFT = r"(?:[0-9a-f]{8}-)?\d+-(?:[0-9a-f]{32}|[0-9a-f]{8})"
"""Pattern of a draft's name; a draft without a machine may be of any."""

_UNKNOWN_S = 7 * 86400.0
"""Age above which a draft of another machine, whose processes cannot be seen from here, is taken for abandoned [s]."""


def draft_name() -> str:
    """An unused name for a draft of this process."""
    return f"{_machine()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"


def is_abandoned(path: Path, name: str, grace_s: float) -> bool:
    """Whether nobody will finish a draft.

    name : of the draft, which may be a part of the path's last name
    grace_s : age up to which the draft of a process of this machine that has ended is left alone [s]
    A draft of another machine is left alone for a week.
    """
    if not re.fullmatch(DRAFT, name) or path.is_symlink():
        return False
    *machine, process, _random = name.split("-")
    if machine in ([_machine()], []) and _is_running(int(process)):
        return False
    return _age_s(path) >= (grace_s if machine == [_machine()] else _UNKNOWN_S)


def _age_s(path: Path) -> float:
    """Time since something in a draft was changed [s]; below any limit if the draft has gone."""
    try:
        return time.time() - max(os.lstat(one).st_mtime for one in tree(path))
    except OSError:
        return -math.inf


def tree(path: Path) -> Iterator[Path]:
    """A file or folder, and everything below it at any depth; no link is followed."""
    yield path
    waiting = [] if path.is_symlink() else [os.fspath(path)]
    while waiting:
        with suppress(OSError), os.scandir(waiting.pop()) as entries:
            for entry in entries:
                yield Path(entry.path)
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(entry.path)


def _is_running(process: int) -> bool:
    """Whether a process of this number runs here; true where that cannot be seen."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


@cache
def _machine() -> str:
    """This machine and its table of processes: containers of one machine do not see each other's."""
    parts = [platform.node().encode()]
    with suppress(OSError):
        parts.append(Path("/etc/machine-id").read_bytes())
    with suppress(OSError):
        parts.append(os.readlink(b"/proc/self/ns/pid"))
    return hashlib.sha256(b"\n".join(parts)).hexdigest()[:8]
