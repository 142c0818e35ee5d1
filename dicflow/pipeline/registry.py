"""The stages there are, by name, found in :mod:`dicflow.stages` and imported when first asked for."""

from __future__ import annotations

import difflib
import importlib
import pkgutil
from collections.abc import Iterable
from functools import cache

import dicflow.stages
from dicflow.engine.node import Node
from dicflow.errors import ConfigurationError

__all__ = ["nearest", "node_class", "stage_names"]


@cache
def stage_names() -> tuple[str, ...]:
    """Names of all stages, sorted: the modules of the package."""
    return tuple(sorted(module.name for module in pkgutil.iter_modules(dicflow.stages.__path__)))


def node_class(name: str) -> type[Node]:
    """The node of a stage. Raises ConfigurationError that suggests the nearest name where there is none."""
    if name not in stage_names():
        raise ConfigurationError(f"no stage '{name}'{nearest(name, stage_names())}; stages: {', '.join(stage_names())}")
    module = importlib.import_module(f"dicflow.stages.{name}")
    found: type[Node] = getattr(module, module.__all__[0])
    return found


def nearest(word: str, words: Iterable[str]) -> str:
    """``", did you mean 'x'?"`` where one of the words is near, else nothing."""
    near = difflib.get_close_matches(word, list(words), n=1, cutoff=0.6)
    return f", did you mean '{near[0]}'?" if near else ""
