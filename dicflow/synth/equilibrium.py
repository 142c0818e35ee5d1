"""A sheet between rigid grips under dead loads, by finite elements: incompressible rubber in plane stress.

Bilinear elements with 2 × 2 Gauss points on a lattice of nodes; the displacements of each load by Newton's method. One
grip rests, the other moves along Y as a whole, by as much as balances the load.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import spsolve

from dicflow.core.arrays import Array
from dicflow.core.material.membrane import sheet_stress, sheet_stress_by_gradient
from dicflow.core.material.models import Model

__all__ = ["Equilibrium", "equilibrium"]

_GAUSS = np.array([-1.0, 1.0]) / np.sqrt(3.0)
_CORNERS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
_ROUNDS, _TOLERANCE = 60, 1e-11
"""Most steps of one search, and largest force that is left at a node, relative to the load."""
_LARGEST = 0.3
"""Largest change of a displacement gradient in one step of a search."""


class Equilibrium(NamedTuple):
    """A sheet at all loads.

    x, y : (col,), (row,) — places of the nodes, from 0 to the width and the length [mm]
    moved : (step, row, col, 2) — their displacements [mm]
    forces : (step,) — at the grip, per thickness [N/mm]
    places, areas : (n, 2) [mm], (n,) [mm²] — of the Gauss points
    gradients : (step, n, 2, 2) — deformation gradients there
    """

    x: Array
    y: Array
    moved: Array
    forces: Array
    places: Array
    areas: Array
    gradients: Array


class _Mesh(NamedTuple):
    """nodes : (n, 2); elements : (e, 4) — their nodes; slopes : (e, 4, 4, 2) — ∂N/∂X at Gauss points; areas : (e, 4)"""

    nodes: Array
    elements: NDArray[np.int64]
    slopes: Array
    areas: Array


def equilibrium(model: Model, c: Array, lines: tuple[Array, Array], forces: Array) -> Equilibrium:
    """Load the grip at the largest Y by forces per thickness [N/mm], one after the other.

    lines : places of the nodes along X and Y, from 0 [mm]
    Raises ValueError where no equilibrium is found.
    """
    mesh = _mesh(*lines)
    joined = _joined(mesh.nodes, float(lines[1][-1]))
    free = np.zeros(joined.shape[1])
    moved, before = [], 0.0
    for force in forces:
        guess = free * (force / before if before else 1.0)
        free = _balanced(model, c, mesh, joined, guess if _is_tame(mesh, joined @ guess) else free, force)
        moved.append((joined @ free).reshape(-1, 2))
        before = force
    shape = (len(moved), len(lines[1]), len(lines[0]), 2)
    return Equilibrium(
        *lines,
        np.array(moved).reshape(shape),
        np.asarray(forces, dtype=float),
        _places(mesh),
        mesh.areas.ravel(),
        np.array([_gradients(mesh, one).reshape(-1, 2, 2) for one in moved]),
    )


def _mesh(x: Array, y: Array) -> _Mesh:
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    row, column = np.indices((len(y) - 1, len(x) - 1)).reshape(2, -1)
    first = row * len(x) + column
    elements = np.stack([first, first + 1, first + len(x) + 1, first + len(x)], axis=-1)
    half = (nodes[elements[:, 2]] - nodes[elements[:, 0]]) / 2.0
    unit = np.array([[((1 + b * t) * a / 4, (1 + a * s) * b / 4) for a, b in _CORNERS] for t in _GAUSS for s in _GAUSS])
    areas = np.repeat(half.prod(axis=1)[:, None], 4, axis=1)
    return _Mesh(nodes, elements, unit / half[:, None, None, :], areas)


def _joined(nodes: Array, length: float) -> csr_matrix:
    """Displacements of all nodes from the free ones, and from that of the grip along Y, which is the last."""
    grip, inside = np.isclose(nodes[:, 1], length), ~np.isclose(nodes[:, 1], 0.0)
    free = np.flatnonzero(np.repeat(inside & ~grip, 2))
    along = 2 * np.flatnonzero(grip) + 1
    rows = np.concatenate([free, along])
    columns = np.concatenate([np.arange(len(free)), np.full(len(along), len(free))])
    return csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(2 * len(nodes), len(free) + 1))


def _balanced(model: Model, c: Array, mesh: _Mesh, joined: csr_matrix, free: Array, force: float) -> Array:
    """Free displacements at which the grip carries a force."""
    for _ in range(_ROUNDS):
        inner, stiffness = _assembled(model, c, mesh, (joined @ free).reshape(-1, 2))
        left = joined.T @ inner
        left[-1] -= force
        if np.abs(left).max() <= _TOLERANCE * max(abs(force), 1.0):
            return free
        change = spsolve((joined.T @ stiffness @ joined).tocsc(), -left)
        largest = np.abs(_gradients(mesh, (joined @ change).reshape(-1, 2)) - np.eye(2)).max()
        free = free + change * min(1.0, _LARGEST / largest)
    raise ValueError(f"no equilibrium was found at {force:g} N/mm; take smaller steps of the load")


def _is_tame(mesh: _Mesh, moved: Array) -> bool:
    """Whether no element is turned inside out, or nearly so."""
    return bool(np.linalg.det(_gradients(mesh, moved.reshape(-1, 2))).min() > 0.2)


def _places(mesh: _Mesh) -> Array:
    shapes = np.array([[(1 + a * s) * (1 + b * t) / 4 for a, b in _CORNERS] for t in _GAUSS for s in _GAUSS])
    return np.asarray(np.einsum("ga,eai->egi", shapes, mesh.nodes[mesh.elements]).reshape(-1, 2))


def _gradients(mesh: _Mesh, moved: Array) -> Array:
    """At the Gauss points of all elements, (e, 4, 2, 2)."""
    return np.asarray(np.eye(2) + np.einsum("eai,egaj->egij", moved[mesh.elements], mesh.slopes))


def _assembled(model: Model, c: Array, mesh: _Mesh, moved: Array) -> tuple[Array, csr_matrix]:
    """Forces at all nodes (2n,), and their derivatives by the displacements, per thickness."""
    gradients = _gradients(mesh, moved)
    weighted = mesh.slopes * mesh.areas[..., None, None]
    force = np.zeros(moved.size)
    places = (2 * mesh.elements[..., None] + np.arange(2)).reshape(-1, 8)
    np.add.at(force, places, np.einsum("egij,egaj->eai", sheet_stress(model, c, gradients), weighted).reshape(-1, 8))
    blocks = np.einsum(
        "egijkl,egaj,egbl->eaibk", sheet_stress_by_gradient(model, c, gradients), weighted, mesh.slopes, optimize=True
    )
    rows, columns = np.repeat(places, 8, axis=1).ravel(), np.tile(places, (1, 8)).ravel()
    return force, csr_matrix((blocks.ravel(), (rows, columns)), shape=(moved.size, moved.size))
