"""The exact truth of an experiment, as arrays and tables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dicflow.core.synthetic.checkerboard import board_corners
from dicflow.core.synthetic.deformation import Deformation, position, strain
from dicflow.core.synthetic.render import Extent, extent_outline
from dicflow.core.synthetic.stand import in_right_frame
from dicflow.core.synthetic.trace import image_of
from dicflow.synth.experiment import Experiment

__all__ = ["board_truth", "field_truth", "length_rows", "region_outline"]

Array = NDArray[np.float64]

_GRID_MM = 1.0


def field_truth(experiment: Experiment) -> dict[str, Array]:
    """Fields on a grid of material points, about 1 mm apart, that covers the speckled region.

    material : (row, col, 2) — X across, Y along the strip at rest [mm]
    xyz : (step, row, col, 3) — in the left camera's frame [mm]
    exx, eyy, gxy : (step, row, col) — engineering strain from the first step, of the fibres along X and Y [-]
    left_px, right_px : (step, row, col, 2) — in the photographs [px]
    """
    states, rig = experiment.deformations, experiment.stand.rig
    material = _material_grid(states[0])
    strains = [strain(states[0], state, material) for state in states]
    return {
        "material": material,
        "xyz": np.array([position(state, material) for state in states]),
        **{name: np.array([getattr(each, name) for each in strains]) for name in ("exx", "eyy", "gxy")},
        "left_px": np.array([image_of(rig.left, state, material) for state in states]),
        "right_px": np.array([image_of(rig.right, in_right_frame(rig, state), material) for state in states]),
    }


def board_truth(experiment: Experiment) -> dict[str, Array]:
    """Inner corners of every board, ``left`` and ``right``: (pair, row, col, 2) in the photographs [px]."""
    rig, corners = experiment.stand.rig, board_corners(experiment.board)
    return {
        "left": np.array([image_of(rig.left, pose, corners) for pose in experiment.poses]),
        "right": np.array([image_of(rig.right, in_right_frame(rig, pose), corners) for pose in experiment.poses]),
    }


def length_rows(experiment: Experiment) -> list[tuple[float, float, float]]:
    """Per step: the imposed length, the distance of the region's ends at mid-width, its part along y [mm]."""
    rows = []
    for imposed, state in zip(experiment.caliper.length_mm, experiment.deformations, strict=True):
        top, bottom = position(state, [[0.0, 0.0], [0.0, state.length]])
        rows.append((float(imposed), float(np.linalg.norm(bottom - top)), float(bottom[1] - top[1])))
    return rows


def region_outline(experiment: Experiment) -> Array:
    """Closed outline (n, 2) of the speckled region in the left photograph of the first step [px]."""
    state = experiment.deformations[0]
    extent = Extent(-state.width / 2.0, state.width / 2.0, 0.0, state.length)
    return image_of(experiment.stand.rig.left, state, extent_outline(extent, 30))


def _material_grid(state: Deformation) -> Array:
    """Material points (row, col, 2) from edge to edge [mm]."""
    across = np.linspace(-state.width / 2.0, state.width / 2.0, round(state.width / _GRID_MM) + 1)
    along = np.linspace(0.0, state.length, round(state.length / _GRID_MM) + 1)
    return np.stack(np.meshgrid(across, along), axis=-1)
