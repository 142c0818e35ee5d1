"""Photographs of a speckled strip by two cameras with distortion, with exact truth, in a second or two."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from dicflow.core.cameras.camera import rotation_matrix
from dicflow.core.synthetic.deformation import Deformation, moved_rigidly, position
from dicflow.core.synthetic.render import GreyLevels, add_noise_and_round, render_strip
from dicflow.core.synthetic.speckle import scatter_speckles
from dicflow.core.synthetic.stand import in_right_frame, verged_stand
from dicflow.core.synthetic.trace import image_of, material_at

SIZE = (600, 500)
FIELD_MM = 25.0
MM_PX = FIELD_MM / SIZE[1]
WIDTH, LENGTH = 19.0, 20.0
STAND = verged_stand(SIZE, FIELD_MM)
RIG = STAND.rig
SPECKLES = scatter_speckles((WIDTH, LENGTH), (0.2, 0.32), 0.11, seed=4)
REGION = (130.0, 70.0, 470.0, 430.0)
"""Part of the first left photograph [px] that the strip covers in both photographs of moderate states."""


class State(NamedTuple):
    """What is changed of the strip at rest: parameters of Deformation, then a rigid motion about its middle."""

    stretch: float = 1.0
    bulge: float = 0.0
    curl: float = 0.0
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)


REST = State(curl=0.3)


def deformation(state: State) -> Deformation:
    """The state in the left camera's frame."""
    plain = Deformation(LENGTH, WIDTH, state.stretch, bulge=state.bulge, curl=state.curl)
    middle = np.array([0.0, state.stretch * LENGTH / 2.0, 0.0])
    turned = rotation_matrix(state.turn)
    placed = moved_rigidly(plain, turned, np.array(state.shift) - turned @ middle)
    return moved_rigidly(placed, STAND.rotation, STAND.translation)


@cache
def clean(state: State) -> tuple[np.ndarray, np.ndarray]:
    """Both photographs before noise (rows, cols)."""
    left = deformation(state)
    looks = (GreyLevels(gain=1.0), GreyLevels(gain=0.93, light=(-0.06, 0.1), phase=1.0))
    views = ((RIG.left, left), (RIG.right, in_right_frame(RIG, left)))
    left_view, right_view = (
        render_strip(camera, seen, SPECKLES, 1.0, look) for (camera, seen), look in zip(views, looks, strict=True)
    )
    return left_view, right_view


def photographs(state: State, noise: float = 0.5, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Both photographs (rows, cols) uint8."""
    left, right = (add_noise_and_round(view, noise, [seed, side]) for side, view in enumerate(clean(state)))
    return left, right


def material(pixels: np.ndarray, state: State = REST) -> np.ndarray:
    """Material points that the left photograph shows at pixels (..., 2) [px]."""
    return material_at(RIG.left, deformation(state), pixels, (0.0, LENGTH / 2.0))


def left_truth(points: np.ndarray, state: State) -> np.ndarray:
    """Pixels (..., 2) of material points in the left photograph."""
    return image_of(RIG.left, deformation(state), points)


def right_truth(points: np.ndarray, state: State) -> np.ndarray:
    """Pixels (..., 2) of material points in the right photograph."""
    return image_of(RIG.right, in_right_frame(RIG, deformation(state)), points)


def space_truth(points: np.ndarray, state: State) -> np.ndarray:
    """Material points in the left camera's frame (..., 3) [mm]."""
    return position(deformation(state), points)
