"""Kernels of the stages, compiled before the first task of a stage."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from dicflow.engine.node import Node

__all__ = ["uncompiled"]


def uncompiled(nodes: Mapping[str, Node]) -> dict[str, Callable[[], None]]:
    return {}
