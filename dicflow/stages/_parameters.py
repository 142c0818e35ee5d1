"""Types of parameters that several stages share, and checks of them against the photographs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated

from pydantic import Field

from dicflow.discovery import nearest
from dicflow.engine.node import Joined, Pixels

__all__ = ["WindowSide", "large_subset", "unknown_steps"]

WindowSide = Annotated[Pixels, Field(gt=0)]
"""One side of a window."""


def unknown_steps(parameter: str, named: Iterable[str], joined: Joined) -> Iterator[tuple[str, str]]:
    """A problem for each step that a parameter names and a stage does not have, with the name that is nearest.

    None while steps may still come.
    """
    if not joined.is_whole:
        return
    known = joined.steps
    ends = f" {known[0]} … {known[-1]}" if known else ""
    for name in named:
        if name not in known:
            yield parameter, f"'{name}' is none of the {len(known)} steps{ends}{nearest(name, known)}"


def large_subset(subset_size: int, photographs: Joined) -> Iterator[tuple[str, str]]:
    """The problem of a subset that no photograph can hold. subset_size : its side [px]"""
    for fact in photographs.facts.values():
        width, height = fact.get("width", subset_size), fact.get("height", subset_size)
        if subset_size > min(width, height):
            problem = f"a subset of {subset_size} px does not fit into the photographs of {width} × {height} px"
            yield "subset_size", f"{problem}; 3 speckles are enough, often 21 to 51 px"
