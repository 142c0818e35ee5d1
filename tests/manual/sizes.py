"""What each package of the default installation weighs, measured in the environment that builds the manual."""

from __future__ import annotations

import re
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

__all__ = ["needed", "sizes_table"]

_LEAST_MB = 2.0
"""Smaller packages are added up."""


def needed(name: str = "dicflow") -> set[str]:
    """Packages that a default installation brings, with those that they need in turn."""
    found: set[str] = set()
    waiting = [name]
    while waiting:
        package = waiting.pop()
        if package not in found and (one := _installed(package)) is not None:
            found.add(package)
            waiting += [_name(line) for line in one.requires or () if "extra ==" not in line]
            waiting += ["distributed"] if package == "dask" else []
    return found


def sizes_table() -> str:
    """Packages by their size, the largest first, as a table."""
    sizes = {name: _size_mb(name) for name in needed()}
    large = sorted((name for name, size in sizes.items() if size >= _LEAST_MB), key=lambda name: -sizes[name])
    rest = [size for size in sizes.values() if size < _LEAST_MB]
    rows = [*((name, sizes[name]) for name in large), (f"{len(rest)} others", sum(rest)), ("all", sum(sizes.values()))]
    return "\n".join(["| package | MB |", "|---|---|", *(f"| {name} | {size:.0f} |" for name, size in rows)])


def _installed(name: str) -> Distribution | None:
    try:
        return distribution(name)
    except PackageNotFoundError:
        return None


def _name(requirement: str) -> str:
    return re.match(r"[\w.-]+", requirement)[0].lower().replace("_", "-")  # type: ignore[index]


def _size_mb(name: str) -> float:
    """Size of a package's files, without the bytecode that Python makes by itself [MB]."""
    one = _installed(name)
    places = [Path(str(one.locate_file(file))) for file in one.files or ()] if one else []
    return sum(place.stat().st_size for place in places if place.suffix != ".pyc" and place.is_file()) / 1e6
