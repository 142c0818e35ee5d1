"""Strongly connected components of a directed graph."""

from __future__ import annotations

import sys
from collections.abc import Callable, Container, Hashable, Iterable, Iterator
from typing import TypeVar

__all__ = ["components"]

_N = TypeVar("_N", bound=Hashable)


def components(nodes: Iterable[_N], following: Callable[[_N], Iterable[_N]], done: Container[_N]) -> Iterator[list[_N]]:
    """Groups of nodes that can reach one another, each group after those that it leads to (Tarjan's algorithm).

    nodes : where to start
    following : the nodes that arrows lead to from a node
    done : nodes that are left out, with all that only they lead to
    """
    low: dict[_N, int] = {}
    path: list[_N] = []
    for start in nodes:
        if start in low or start in done:
            continue
        waiting = [(start, _entered(start, low, path), iter(following(start)))]
        while waiting:
            node, number, arrows = waiting[-1]
            step = next((one for one in arrows if one not in done), None)
            if step is None:
                waiting.pop()
                if low[node] == number:
                    yield _group(node, low, path)
                elif waiting:
                    low[waiting[-1][0]] = min(low[waiting[-1][0]], low[node])
            elif step not in low:
                waiting.append((step, _entered(step, low, path), iter(following(step))))
            else:
                low[node] = min(low[node], low[step])


def _entered(node: _N, low: dict[_N, int], path: list[_N]) -> int:
    low[node] = len(low)
    path.append(node)
    return low[node]


def _group(node: _N, low: dict[_N, int], path: list[_N]) -> list[_N]:
    """Take a complete group off the path."""
    group = path[path.index(node) :]
    del path[len(path) - len(group) :]
    low.update(dict.fromkeys(group, sys.maxsize))
    return group
