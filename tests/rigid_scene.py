"""A speckled plate that only moves, before two cameras: photographs with exact truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dicflow.core.cameras.camera import rotation_matrix
from dicflow.core.synthetic.checkerboard import Checkerboard
from dicflow.core.synthetic.deformation import Deformation, moved_rigidly, position
from dicflow.core.synthetic.speckle import scatter_speckles
from dicflow.core.synthetic.stand import board_poses, verged_stand
from dicflow.core.synthetic.trace import material_at
from dicflow.io.caliper import Caliper
from dicflow.synth import write_experiment
from dicflow.synth.experiment import Experiment

SIZE = (1000, 800)
FIELD_MM = (125.0, 100.0)
PIXEL_MM = FIELD_MM[1] / SIZE[1]
STAND = verged_stand(SIZE, FIELD_MM[1], baseline=160.0)
PLATE = Deformation(length=50.0, width=56.0, curl=0.4)
REGION = (308, 240, 692, 560)
"""Part of the first left photograph that is measured [px]."""
NOISE = 2.0
SPECKLES = scatter_speckles((PLATE.width, PLATE.length), (4.0 * PIXEL_MM, 7.0 * PIXEL_MM), 2.5 * PIXEL_MM, seed=11)
"""As soft as a lens leaves them; sharper ones are measured worse than their noise, as interpolation errs on them."""
BOARD = Checkerboard(10, 7, 7.0, 3.0, 1.3 * PIXEL_MM)
BOARDS = 25

MOTIONS = {
    "x": ((20.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "y": ((0.0, -20.0, 0.0), (0.0, 0.0, 0.0)),
    "z, away": ((0.0, 0.0, 20.0), (0.0, 0.0, 0.0)),
    "z, nearer": ((0.0, 0.0, -20.0), (0.0, 0.0, 0.0)),
    "about x": ((0.0, 0.0, 0.0), (10.0, 0.0, 0.0)),
    "about y": ((0.0, 0.0, 0.0), (0.0, -10.0, 0.0)),
    "about z": ((0.0, 0.0, 0.0), (0.0, 0.0, 10.0)),
    "mixed, small": ((-3.0, 2.0, 4.0), (-2.0, 3.0, -1.0)),
    "mixed": ((12.0, -9.0, 15.0), (6.0, -7.0, 5.0)),
    "mixed, all": ((-20.0, 20.0, 20.0), (-10.0, 10.0, -10.0)),
}
"""Translation [mm] along, and rotation [°] about the axes of the stand: X along the baseline, Y down, Z away."""


def moved(translation: tuple[float, ...], rotation_deg: tuple[float, ...]) -> Deformation:
    """The plate in the left camera's frame, after a motion about its middle."""
    turn = rotation_matrix(np.radians(rotation_deg))
    middle = np.array([0.0, PLATE.length / 2.0, 0.0])
    return moved_rigidly(moved_rigidly(PLATE, turn, translation - turn @ middle), STAND.rotation, STAND.translation)


REST = moved((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
STATES = [REST, *(moved(*motion) for motion in MOTIONS.values())]


def write_photographs(folder: Path) -> None:
    """Photographs of the plate at rest and after each motion, and of the boards."""
    steps = len(STATES)
    experiment = Experiment(
        stand=STAND,
        speckles=SPECKLES,
        deformations=tuple(STATES),
        caliper=Caliper(("rigid",) * steps, np.zeros(steps), np.full(steps, PLATE.length)),
        board=BOARD,
        poses=tuple(board_poses(STAND, BOARD, BOARDS, (-40.0, 80.0), seed=11)),
        noise=NOISE,
        seed=11,
    )
    write_experiment(folder, experiment, workers=2)


def displacement_truth(pixels: np.ndarray, step: int) -> np.ndarray:
    """Displacement (..., 3) in the left camera's frame [mm] of what the first left photograph shows at (..., 2) px."""
    material = material_at(STAND.rig.left, REST, pixels, (0.0, PLATE.length / 2.0))
    return position(STATES[step], material) - position(REST, material)
