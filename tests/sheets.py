"""A stretched sheet between rigid grips by finite elements, as truth for fields: incompressible, in plane stress."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import spsolve

from dicflow.core.material.membrane import sheet_stress
from dicflow.core.material.models import Model

__all__ = ["Solution", "solve"]

_GAUSS = np.array([-1.0, 1.0]) / np.sqrt(3.0)
_CORNERS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])


class Solution(NamedTuple):
    """At the Gauss points (n,): places (n, 2), areas (n,), gradients (step, n, 2, 2); forces per thickness (step,)."""

    places: np.ndarray
    areas: np.ndarray
    gradients: np.ndarray
    forces: np.ndarray


def solve(
    model: Model, c: np.ndarray, size: tuple[float, float], cells: tuple[int, int], pulls: np.ndarray
) -> Solution:
    """Displace the upper grip by ``pulls`` (step,) along Y, one after the other, by Newton's method.

    size : (width, length); cells : across and along
    """
    nodes, elements = _mesh(size, cells)
    slopes, area = _shape_slopes(size, cells)
    fixed = np.isclose(nodes[:, 1], 0.0) | np.isclose(nodes[:, 1], size[1])
    free = np.repeat(~fixed, 2)
    upper = np.isclose(nodes[:, 1], size[1])
    moved, gradients, forces = np.zeros_like(nodes), [], []
    for pull in pulls:
        moved = moved * (pull / moved[upper, 1].max() if moved[upper, 1].max() > 0 else 1.0)
        if not moved.any():
            moved[:, 1] = pull * nodes[:, 1] / size[1]
        for _ in range(30):
            force, stiffness = _assembled(model, c, moved, elements, slopes, area)
            if np.abs(force[free]).max() < 1e-11:
                break
            change = np.zeros(moved.size)
            change[free] = spsolve(stiffness[free][:, free].tocsc(), -force[free])
            moved = moved + change.reshape(moved.shape)
        else:
            raise AssertionError("no equilibrium was found")
        gradients.append(_gradients(moved, elements, slopes).reshape(-1, 2, 2))
        forces.append(force.reshape(-1, 2)[upper, 1].sum())
    weights = _places(nodes, elements)
    return Solution(weights, np.full(len(weights), area), np.array(gradients), np.array(forces))


def _mesh(size: tuple[float, float], cells: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    x, y = (np.linspace(0.0, side, count + 1) for side, count in zip(size, cells, strict=True))
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    row, column = np.indices((cells[1], cells[0])).reshape(2, -1)
    first = row * (cells[0] + 1) + column
    return nodes, np.stack([first, first + 1, first + cells[0] + 2, first + cells[0] + 1], axis=-1)


def _shape_slopes(size: tuple[float, float], cells: tuple[int, int]) -> tuple[np.ndarray, float]:
    """∂N/∂X at the four Gauss points of every element, (4, 4, 2), and the area of one point."""
    half = np.array(size) / cells / 2.0
    slopes = [
        [((1 + b * t) * a / 4 / half[0], (1 + a * s) * b / 4 / half[1]) for a, b in _CORNERS]
        for t in _GAUSS
        for s in _GAUSS
    ]
    return np.array(slopes), float(half.prod())


def _places(nodes: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Places of all Gauss points, (element × 4, 2)."""
    shapes = np.array([[(1 + a * s) * (1 + b * t) / 4 for a, b in _CORNERS] for t in _GAUSS for s in _GAUSS])
    return np.einsum("ga,eai->egi", shapes, nodes[elements]).reshape(-1, 2)


def _gradients(moved: np.ndarray, elements: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    return np.eye(2) + np.einsum("eai,gaj->egij", moved[elements], slopes)


def _element_forces(model, c, local, slopes, area) -> np.ndarray:
    """Nodal forces of elements with displacements (element, 4, 2), per thickness."""
    gradient = np.eye(2) + np.einsum("eai,gaj->egij", local, slopes)
    return np.einsum("egij,gaj->eai", sheet_stress(model, c, gradient), slopes) * area


def _assembled(model, c, moved, elements, slopes, area):
    local = moved[elements]
    force = np.zeros(moved.size)
    places = (2 * elements[..., None] + np.arange(2)).reshape(len(elements), 8)
    np.add.at(force, places, _element_forces(model, c, local, slopes, area).reshape(-1, 8))
    columns = []
    for unit in np.eye(8).reshape(8, 4, 2) * 1e-6:
        change = _element_forces(model, c, local + unit, slopes, area) - _element_forces(
            model, c, local - unit, slopes, area
        )
        columns.append(change.reshape(-1, 8) / 2e-6)
    blocks = np.stack(columns, axis=-1)
    rows, cols = np.repeat(places, 8, axis=1).ravel(), np.tile(places, (1, 8)).ravel()
    return force, csr_matrix((blocks.ravel(), (rows, cols)), shape=(moved.size, moved.size))
