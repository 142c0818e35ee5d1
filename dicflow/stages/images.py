"""Photographs of one or two cameras, one product per step."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

from dicflow.engine.node import Node, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import InputError
from dicflow.kinds.images import Images as Photographs

__all__ = ["Images"]


class Images(Node):
    """Read the photographs as grey levels.

    One step per left photograph, named by its stem; no two may share one. Those of a pattern follow in natural order of
    the names, those of a list as they are listed. With ``right`` the photographs are paired by the numbers in their
    names, or by order if the numbers differ.
    """

    title: ClassVar = "read photographs"
    scope: ClassVar = Scope.STEP
    gives: ClassVar = "images"

    stage: Literal["images"] = "images"
    left: str | list[str] = parameter(
        ..., "photographs of the left camera: a pattern such as left/*.png, or a list", affects="speed"
    )
    right: str | list[str] | None = parameter(
        None, "photographs of the right camera; absent for a measurement with one camera", affects="speed"
    )

    def steps(self, folder: Path) -> Mapping[str, Mapping[str, Path]]:
        from dicflow.io.images import pair_names

        left = _photographs(folder, self.left, "left")
        if self.right is None:
            return {path.stem: {"left": path} for path in left.values()}
        right = _photographs(folder, self.right, "right")
        pairs = pair_names(list(left), list(right)).pairs
        return {Path(a).stem: {"left": left[a], "right": right[b]} for a, b in pairs}

    def check(self, path: Path) -> dict[str, Any]:
        from dicflow.io.images import probe

        return dict(probe(path))

    def agree(
        self,
        facts: Mapping[Path, Mapping[str, Any]],
        steps: Mapping[str, Mapping[str, Path]],
        inputs: Mapping[str, tuple[str, ...]],
    ) -> None:
        first = next(iter(facts))
        for path, fact in facts.items():
            for side in ("width", "height", "bits"):
                if fact[side] != facts[first][side]:
                    raise InputError(
                        f"{path}: {_size(fact)}, but {first.name} has {_size(facts[first])}; "
                        "all photographs of both cameras must have one size and depth"
                    )
        for files in steps.values():
            turned = {path: facts[path]["orientation"] for path in files.values()}
            if len(set(turned.values())) > 1:
                path = next(path for path, value in turned.items() if value != 1)
                raise InputError(
                    f"{path}: marked as rotated (EXIF orientation {turned[path]}) while its partner is not; "
                    "remove the mark from the file, and mount both cameras alike"
                )

    def run(self, left: Path, right: Path | None = None) -> Product:
        from dicflow.io.images import read_grey

        return Photographs.write(read_grey(left), None if right is None else read_grey(right))


def _photographs(folder: Path, patterns: str | list[str], side: str) -> dict[str, Path]:
    """Files that match the patterns, by file name. Raises InputError if no file matches or two have one stem."""
    by_stem: dict[str, Path] = {}
    for pattern in [patterns] if isinstance(patterns, str) else patterns:
        for path in _matching_files(folder, pattern, side):
            if (other := by_stem.setdefault(path.stem, path)) != path:
                raise InputError(
                    f"{side}: {other} and {path} would both be step '{path.stem}'; "
                    "rename one of them, or leave it out of the pattern"
                )
    if not by_stem:
        raise InputError(
            f"{side}: no photograph matches {patterns!r} in {folder}; check the pattern, or start from 'dicflow init'"
        )
    return {path.name: path for path in by_stem.values()}


def _matching_files(folder: Path, pattern: str, side: str) -> list[Path]:
    """The file of this name, or the photographs that match a pattern, in natural order."""
    from dicflow.io.images import SUFFIXES, natural_key

    if not any(sign in pattern for sign in "*?["):
        if (folder / pattern).is_dir():
            raise InputError(f"{side}: {pattern!r} is a folder; write a pattern such as {pattern.rstrip('/')}/*.png")
        return [folder / pattern]
    photographs = (path for path in _glob(folder, pattern) if path.suffix.lower() in SUFFIXES)
    return sorted(photographs, key=lambda path: (natural_key(path.name), path))


def _glob(folder: Path, pattern: str) -> list[Path]:
    """Files below a folder that match a pattern; an absolute pattern starts at its own root."""
    path = Path(pattern)
    return (
        list(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
        if path.is_absolute()
        else list(folder.glob(pattern))
    )


def _size(fact: Mapping[str, Any]) -> str:
    return f"{fact['width']} × {fact['height']} px at {fact['bits']} bit"
