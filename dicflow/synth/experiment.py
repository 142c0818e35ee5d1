"""Replicas of five tensile tests on latex strips: every length that the caliper measured is imposed exactly.

The tests are those of S. Nadarajah, *Measuring full-field deformation of hyperelastic material using digital image
correlation* (MSc thesis, University of Moratuwa): strips with marker-pen speckles, hung from their upper edge, loaded
with weights and unloaded, photographed by two cameras at every step.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import as_file, files
from typing import NamedTuple

import numpy as np

from dicflow.core.cameras.camera import rotation_matrix
from dicflow.core.synthetic.checkerboard import Checkerboard
from dicflow.core.synthetic.deformation import Deformation, moved_rigidly
from dicflow.core.synthetic.speckle import Speckles, scatter_speckles
from dicflow.core.synthetic.stand import Stand, board_poses, verged_stand
from dicflow.io.caliper import Caliper, read_caliper

__all__ = ["Experiment", "latex_experiment", "sample_experiment"]

_PHOTOGRAPH = (1440, 1920)
_SPECKLE_PX = (3.0, 7.0)
_SPECKLE_EDGE_PX = 1.1
_BOARD_EDGE_PX = 1.3
_SWAY_DEG = 0.1
_SWAY_MM = 0.15

_SAMPLE_STEPS = (0, 2, 5, 8, 11, 18, 20, 21)
"""Steps of the third strip that go to a stretch of 2.05 and back, none more than a quarter beyond the one before."""


class _Strip(NamedTuple):
    """One of the five strips.

    width : of the strip [mm]
    field : height that a photograph shows [mm]
    contraction : exponent of the lateral contraction; a wide strip is held by its clamps and narrows less
    board : what the cameras are calibrated with
    """

    width: float
    field: float
    contraction: float
    board: Checkerboard


_STRIPS = {
    1: _Strip(20.0, 176.0, 0.5, Checkerboard(10, 7)),
    2: _Strip(20.0, 176.0, 0.5, Checkerboard(10, 7)),
    3: _Strip(20.0, 165.0, 0.5, Checkerboard(10, 7)),
    4: _Strip(60.0, 140.0, 0.35, Checkerboard(8, 5)),
    5: _Strip(60.0, 140.0, 0.15, Checkerboard(8, 5)),
}


class Experiment(NamedTuple):
    """All that the photographs of a test show, and its truth.

    deformations : the strip at each step, in the left camera's frame
    caliper : the imposed lengths
    poses : places of the board, in the left camera's frame
    overhang : bare strip beyond each end of the speckled region [mm]
    noise : standard deviation of the grey levels
    seed : of the noise; everything else is already determined
    """

    stand: Stand
    speckles: Speckles
    deformations: tuple[Deformation, ...]
    caliper: Caliper
    board: Checkerboard
    poses: tuple[Deformation, ...]
    overhang: float = 4.0
    noise: float = 2.0
    seed: int = 0


def latex_experiment(
    number: int, scale: float = 1.0, steps: Sequence[int] | None = None, boards: int = 20
) -> Experiment:
    """Replica of one of the five tests.

    number : 1 … 5
    scale : of the photographs against 1440 × 1920 px; speckles keep their size in pixels
    steps : which rows of the caliper table to photograph; all, unless given
    boards : number of board pairs
    Raises ValueError for a number outside 1 … 5.
    """
    if number not in _STRIPS:
        raise ValueError(f"the latex experiments are numbered 1 to 5, got {number}")
    strip, caliper = _STRIPS[number], _caliper(number)
    size = (round(_PHOTOGRAPH[0] * scale), round(_PHOTOGRAPH[1] * scale))
    pixel = strip.field / size[1]
    stand = verged_stand(size, strip.field)
    board = strip.board._replace(edge=_BOARD_EDGE_PX * pixel)
    deformations = _deformations(number, strip, caliper, stand)
    taken = list(range(len(deformations)) if steps is None else steps)
    return Experiment(
        stand=stand,
        speckles=_speckles((strip.width, float(caliper.length_mm[0])), pixel, number),
        deformations=tuple(deformations[k] for k in taken),
        caliper=Caliper(tuple(caliper.phase[k] for k in taken), caliper.load_g[taken], caliper.length_mm[taken]),
        board=board,
        poses=tuple(board_poses(stand, board, boards, seed=number)),
        seed=number,
    )


def sample_experiment(scale: float = 0.5, boards: int = 12) -> Experiment:
    """The reduced replica of the third test that ``data_samples`` holds; its cameras have half the noise."""
    return latex_experiment(3, scale, _SAMPLE_STEPS, boards)._replace(noise=1.0)


def _caliper(number: int) -> Caliper:
    with as_file(files("dicflow.synth") / "latex" / f"experiment_{number}.csv") as path:
        return read_caliper(path)


def _speckles(size: tuple[float, float], pixel: float, seed: int) -> Speckles:
    """Dots of 3 to 7 px in the first photograph; ``pixel`` is the size of one on the strip [mm]."""
    diameter = (_SPECKLE_PX[0] * pixel, _SPECKLE_PX[1] * pixel)
    return scatter_speckles(size, diameter, _SPECKLE_EDGE_PX * pixel, seed=seed)


def _deformations(number: int, strip: _Strip, caliper: Caliper, stand: Stand) -> list[Deformation]:
    """The strip at every step: stretched to the caliper's length, swaying a little, bulging more as it stretches."""
    rng = np.random.default_rng([number, 0x57A1])
    length = float(caliper.length_mm[0])
    upper_edge = np.array([0.0, -0.5 * float(caliper.length_mm.max()), 0.0])
    states = []
    for k, imposed in enumerate(caliper.length_mm):
        excess = float(imposed) / length - 1.0
        turn, shift, billow = rng.normal(size=3), rng.normal(size=3), rng.normal(size=2)
        moving = float(k > 0)
        state = Deformation(
            length=length,
            width=strip.width,
            stretch=1.0 + excess,
            contraction=strip.contraction,
            inhomogeneity=0.06,
            bulge=-length * (0.004 + 0.006 * excess + 0.0008 * moving * billow[0]),
            curl=strip.width * (0.002 + 0.004 * excess + 0.0005 * moving * billow[1]),
            rotation=rotation_matrix(moving * np.radians(_SWAY_DEG) * turn),
            translation=upper_edge + moving * _SWAY_MM * shift,
        )
        states.append(moved_rigidly(state, stand.rotation, stand.translation))
    return states
