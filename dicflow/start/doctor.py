"""Whether this machine and installation can do what dicflow needs."""

from __future__ import annotations

import os
import platform
import shutil
import socket
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from dicflow.core.matching.detectors import DETECTORS
from dicflow.engine.kernel_cache import VARIABLE

__all__ = ["Check", "checks"]

_PACKAGES = ("numpy", "scipy", "numba", "opencv-python-headless", "zarr", "dask", "distributed", "pydantic", "xarray")
_FREE_GB = 2.0


class Check(NamedTuple):
    """Subject of a check, whether it passed, and the finding with the remedy."""

    subject: str
    ok: bool
    finding: str


def checks(store: Path) -> Iterator[Check]:
    """Check Python, the packages, the machine, the store's folder and the loopback address."""
    yield Check("python", True, f"{platform.python_version()} on {platform.system()} {platform.machine()}")
    yield Check("packages", True, ", ".join(f"{name} {version(name)}" for name in _PACKAGES))
    yield _detectors()
    yield _compiler()
    yield Check("cores", True, str(os.cpu_count()))
    yield from _folder(store)
    yield _loopback()


def _detectors() -> Check:
    import cv2

    missing = [name for name in DETECTORS if not hasattr(cv2, f"{name}_create")]
    if missing:
        return Check(
            "detectors", False, f"OpenCV {cv2.__version__} lacks {', '.join(missing)}; install opencv-python-headless<5"
        )
    return Check("detectors", True, ", ".join(DETECTORS))


def _compiler() -> Check:
    """Compiles a kernel, and looks whether it can be kept."""
    from numba import njit

    try:
        njit(_increment)(1)
    except Exception as error:
        return Check("compiler", False, f"numba cannot compile: {error}; install numba and llvmlite again")
    try:
        kept = njit(cache=True)(_increment)
    except RuntimeError:
        remedy = f"set {VARIABLE} to a folder that can be written"
        return Check("compiler", False, f"numba finds no folder to keep compiled kernels in; {remedy}")
    return Check("compiler", True, f"numba compiles, and keeps kernels in {Path(kept.stats.cache_path).parent}")


def _increment(x: int) -> int:
    return x + 1


def _folder(store: Path) -> Iterator[Check]:
    place = store.absolute()
    while not place.exists():
        place = place.parent
    writable = _writable(place)
    yield Check(
        "store",
        writable,
        f"{place} can be written" if writable else f"{place} cannot be written; choose another with --store",
    )
    free = shutil.disk_usage(place).free / 1e9
    enough = free >= _FREE_GB
    yield Check(
        "disk", enough, f"{free:.1f} GB free" + ("" if enough else f"; a test of 22 steps needs about {_FREE_GB} GB")
    )


def _writable(folder: Path) -> bool:
    """Whether a file can be made there; asking for permission alone is not enough for root."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _loopback() -> Check:
    try:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
    except OSError as error:
        return Check("loopback", False, f"127.0.0.1 cannot be used: {error}; run without --dashboard")
    return Check("loopback", True, "the dashboard can use 127.0.0.1")
