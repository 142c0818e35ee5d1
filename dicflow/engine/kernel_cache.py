"""Where compiled kernels are kept: a folder of this account, named by the source that they are compiled from.

Numba looks only at a kernel's own module to see whether a kept kernel is still right. A kernel also holds what its
module imports: other kernels, constants, types. So the name of the folder has the digest of all these modules.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

__all__ = ["VARIABLE", "account_folder", "keep_kernels", "kernel_folder", "kernel_mark"]

VARIABLE = "NUMBA_CACHE_DIR"
_UNUSED_S = 30 * 86400.0
"""Time since kernels were used last, after which they are deleted [s]."""
_COMPILES = re.compile(r"^from numba import", re.MULTILINE)
_NAME = re.compile("kernels-[0-9a-f]{16}")
_IMPORTED = re.compile(r"^\s*from dicflow\.(core[\w.]*) import", re.MULTILINE)


def keep_kernels() -> None:
    """Let numba keep kernels in :func:`kernel_folder`, unless the environment names a folder or numba is loaded.

    Those of other sources that nobody has used for a month are deleted.
    """
    if VARIABLE not in os.environ and "numba" not in sys.modules and (folder := kernel_folder()) is not None:
        os.environ[VARIABLE] = str(folder)
        with suppress(OSError):
            folder.mkdir(exist_ok=True)
            os.utime(folder)  # says when it was used last
            _delete_unused(folder)


def kernel_folder() -> Path | None:
    """The folder of the kernels of this source in :func:`account_folder`. None without any."""
    folder = account_folder()
    return folder and folder / f"kernels-{_source()[:16]}"


def kernel_mark(name: str) -> Path | None:
    """The file which says that some kernels of this source are kept for this machine and these versions.

    None where kernels are not kept.
    """
    chosen = os.environ.get(VARIABLE)
    folder = Path(chosen) if chosen else kernel_folder()
    if folder is None:
        return None
    there = next(place for place in (folder, *folder.parents) if place.exists())
    usable = there.is_dir() and os.access(there, os.W_OK)
    return folder / f"{name}-{_machine()}.compiled" if usable else None


@cache
def _machine() -> str:
    """Short digest of all that kept kernels depend on."""
    from importlib.metadata import version

    system = platform.node(), platform.machine(), platform.python_version(), version("numba")
    parts = (_source(), _place(Path(__file__).parents[1]), *system)
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def account_folder() -> Path | None:
    """The first folder that can be used: in the account's cache, or among temporary files. None without any.

    What is in it runs as code, so that a folder that another account owns or may write is not used.
    """
    return next((place for place in _places() if _is_private(place)), None)


def _delete_unused(used: Path) -> None:
    """Delete the folders of kernels beside one that were used last before the limit. Raises OSError.

    The folder above is this account's alone. A process that uses one of them after all compiles anew what it misses.
    """
    before = time.time() - _UNUSED_S
    with os.scandir(used.parent) as entries:
        for entry in entries:
            is_kernels = _NAME.fullmatch(entry.name) and entry.is_dir(follow_symlinks=False)
            if is_kernels and entry.name != used.name and entry.stat(follow_symlinks=False).st_mtime < before:
                shutil.rmtree(entry, ignore_errors=True)


def _places() -> Iterator[Path]:
    known = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or os.path.expanduser("~/.cache")
    if os.path.isabs(known):
        yield Path(known, "dicflow")
    user = os.geteuid() if hasattr(os, "geteuid") else os.environ.get("USERNAME", "user")
    yield Path(tempfile.gettempdir(), f"dicflow-{user}")


def _is_private(folder: Path) -> bool:
    """Whether only this account can write there; the folder is made if it is missing."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            found = folder.lstat()
    except OSError:
        return False
    if not hasattr(os, "geteuid"):
        return True
    return not folder.is_symlink() and found.st_uid == os.geteuid() and not found.st_mode & 0o022


@cache
def _source() -> str:
    """Digest of the source of the kernels."""
    return _digest(Path(__file__).parents[1])


def _place(package: Path) -> str:
    """Where the package lies, and when its modules were written: numba takes no kernel of another place or time."""
    stamps = ((path, path.stat()) for path in sorted((package / "core").rglob("*.py")))
    return "\n".join([str(package), *(f"{path.name} {stamp.st_mtime_ns} {stamp.st_size}" for path, stamp in stamps)])


def _digest(package: Path) -> str:
    """Digest of the modules that compile kernels, and of those that they import."""
    texts = {_module(path, package): path.read_bytes() for path in sorted((package / "core").rglob("*.py"))}
    needed = {name for name, text in texts.items() if _COMPILES.search(text.decode())}
    waiting = list(needed)
    while waiting:
        found = set(_IMPORTED.findall(texts[waiting.pop()].decode())) & texts.keys()
        waiting += found - needed
        needed |= found
    whole = hashlib.sha256()
    for name in sorted(needed):
        whole.update(b"%s %d\n%s" % (name.encode(), len(texts[name]), texts[name]))
    return whole.hexdigest()


def _module(path: Path, package: Path) -> str:
    """Name of a module below the package, as ``core.status``."""
    return ".".join(path.relative_to(package).with_suffix("").parts)
