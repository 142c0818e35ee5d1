"""Photographs of one subject, as the stage that reads them finds them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Any, NamedTuple

from dicflow.engine.files import FilePart
from dicflow.engine.node import Node
from dicflow.errors import InputError
from dicflow.pipeline.registry import node_class
from dicflow.start.choice import By
from dicflow.start.facts import Facts
from dicflow.start.layouts import Series
from dicflow.start.patterns import listed, patterns_of
from dicflow.start.videos import UNKNOWN_OFFSET, video_parameters
from dicflow.start.ways import Way, chosen_way

__all__ = ["Photographs", "maker", "photographs_of"]


class Photographs(NamedTuple):
    """Photographs of one subject.

    left, right : patterns below the folder; right is empty for one camera
    steps : files of each step, as the stage of the photographs finds them
    way : what makes pairs; None for one camera
    frames : how the clocks of two videos are joined, and which of their frames are used; empty for photographs
    """

    left: list[str]
    right: list[str]
    steps: Mapping[str, Mapping[str, Path | FilePart]]
    way: Way | None = None
    frames: Mapping[str, Any] = MappingProxyType({})

    @property
    def parameters(self) -> dict[str, Any]:
        """What the stage of the photographs must know beside the patterns."""
        return {**_listed(self.way), **self.frames}

    def __str__(self) -> str:
        if not self.right:
            return f"{len(self.steps)} photographs of one camera, {listed(self.left)}"
        how = f" {self.way.words}" if self.way is not None and self.way.is_listed else ""
        if self.frames.get("offset") == UNKNOWN_OFFSET:
            how = (
                " as if both cameras had begun at once, since nothing that both saw joins their clocks; correct offset"
            )
        return f"{len(self.steps)} pairs{how}, {listed(self.left)} and {listed(self.right)}"


def photographs_of(
    folder: Path,
    left: Series,
    right: Series | None,
    paths: Sequence[PurePosixPath],
    facts: Facts,
    by: By | None,
    select: Mapping[str, int] | None = None,
) -> Photographs:
    """The photographs as patterns, and the steps that the stage of the photographs makes of them.

    select : which frames of a video are used; None for a few hundred at most
    """
    named, way = {"left": patterns_of(left.files, paths)}, None
    frames: dict[str, Any] = {}
    try:
        if right:
            way = chosen_way(left, right, facts.taken, by)
            named = way.patterns(left, right, paths)
        frames = video_parameters([folder / one.files[0] for one in (left, right) if one], select)
        steps = maker("images")(**named, **_listed(way), **frames).steps(folder) or {}
    except InputError as error:
        raise InputError(f"{folder / named['left'][0]}: {error}") from error
    return Photographs(named["left"], named.get("right", []), steps, way, frames)


def _listed(way: Way | None) -> dict[str, str]:
    """What the stage of the photographs must know of a way to make pairs; empty for what it assumes."""
    return {"pair_by": "order"} if way is not None and way.is_listed else {}


def maker(stage: str) -> Callable[..., Node]:
    """The node of a stage as a function of its parameters."""
    return node_class(stage)
