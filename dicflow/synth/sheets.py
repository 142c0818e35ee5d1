"""Tests on sheets of one rubber between rigid grips, whose fields are in equilibrium with the weights.

Three shapes of the thesis are loaded with weights, and unloaded on request: a strip of 60 × 20 mm, a square of
60 × 60 mm and a sheet of 20 × 60 mm, wider than high. A folder has::

    boards/left/board_00.png …    boards/right/…
    strip/photos/left/step_00.png …    strip/photos/right/…    square/…    wide/…
    strip/weights.csv             weight at each step, as a balance shows it
    strip/region.geojson          outline of the sheet in the first left photograph
    strip/truth.npz               the sheet in equilibrium at each step
    truth/rubber.json             model, constants and thickness
    truth/rig.json                the cameras
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Bytes
from dicflow.core.cameras.camera import rotation_matrix
from dicflow.core.material.models import MODELS
from dicflow.core.material.response import stress_in_mode
from dicflow.core.synthetic.checkerboard import Checkerboard
from dicflow.core.synthetic.deformation import Deformation, moved_rigidly
from dicflow.core.synthetic.render import Extent, add_noise_and_round, extent_outline, painted
from dicflow.core.synthetic.sheet import Sheet, image_of_sheet, sheet_between, trace_sheet
from dicflow.core.synthetic.speckle import Speckles, darkness, scatter_speckles
from dicflow.core.synthetic.stand import Stand, board_poses, verged_stand
from dicflow.io.rig import write_rig
from dicflow.synth.equilibrium import Equilibrium, equilibrium
from dicflow.synth.pictures import LOOKS, SIDES, Progress, Taken, outline_text, take_board, write_photographs

__all__ = ["CONSTANTS", "SHAPES", "Rubber", "Shape", "loads_of", "softened", "solved", "write_sheets"]

GRAVITY = 9.80665
CONSTANTS: Mapping[str, tuple[float, ...]] = {
    "neo_hooke": (0.2,),
    "mooney_rivlin": (0.16, 0.04),
    "yeoh": (0.2, -0.01, 0.0015),
    "ogden_2": (0.55, 1.4, 0.004, 5.5),
}
"""Constants of a made rubber, by model [MPa]."""
_PHOTOGRAPH, _FIELD = (1440, 1920), 150.0
"""Size of a photograph at scale 1 [px], and the height that it shows [mm]."""
_BOARD = Checkerboard(10, 7)
_SPECKLE_PX, _SPECKLE_EDGE_PX, _BOARD_EDGE_PX = (3.0, 7.0), 1.1, 1.3
_SWAY_DEG, _SWAY_MM = 0.1, 0.15
_SOFTENING = 0.5
"""Share of the largest load by which unloading is below it where most of the damage shows."""
_ELEMENTS = 40
"""Elements across the shorter side of a sheet."""


class Shape(NamedTuple):
    """A sheet between grips: width and length [mm], the mode that it is closest to, and its largest stretch there."""

    width: float
    length: float
    mode: str
    stretch: float


SHAPES: Mapping[str, Shape] = {
    "strip": Shape(20.0, 60.0, "uniaxial", 2.2),
    "square": Shape(60.0, 60.0, "planar", 1.9),
    "wide": Shape(60.0, 20.0, "planar", 1.9),
}


class Rubber(NamedTuple):
    """A rubber and how its sheets are tested.

    model : name, see :mod:`dicflow.core.material.models`
    constants : (p,) [MPa and numbers]
    thickness : of the sheet [mm]; of what is stated, the seed makes it differ by ``u_thickness``
    up, down : steps with weights while loading, and after it
    damage : share of the load that is lost on unloading, far below the largest one, at the same deformation
    u_mass : standard deviation of a weight about what the balance shows [g]
    noise : standard deviation of the grey levels
    """

    model: str = "mooney_rivlin"
    constants: tuple[float, ...] = CONSTANTS["mooney_rivlin"]
    thickness: float = 0.21
    u_thickness: float = 0.005
    up: int = 9
    down: int = 0
    damage: float = 0.0
    u_mass: float = 0.1
    noise: float = 2.0
    seed: int = 0

    @property
    def true_thickness(self) -> float:
        """Of all sheets [mm]."""
        share = float(np.random.default_rng([self.seed, 0x7E]).standard_normal())
        return self.thickness + self.u_thickness * share


def loads_of(rubber: Rubber, shape: Shape) -> tuple[Array, Array]:
    """Masses on a sheet at each step, and what the balance shows of them, (step,) each [g]; 0 at rest."""
    up, down = (np.linspace(1.0, shape.stretch, count + 1) for count in (rubber.up, rubber.down))
    loading, lower = (_grams(rubber, shape, stretch) for stretch in (up[1:], down[-2::-1]))
    unloading = loading[-1] * softened(lower / loading[-1], rubber.damage)
    shown = np.round(np.concatenate([[0.0], loading, unloading]))
    rng = np.random.default_rng([rubber.seed, round(shape.width), round(shape.length)])
    return np.where(shown > 0.0, shown + rubber.u_mass * rng.standard_normal(len(shown)), 0.0), shown


def _grams(rubber: Rubber, shape: Shape, stretch: Array) -> Array:
    """Masses that stretch a sheet about so far, (n,)."""
    stress = stress_in_mode(MODELS[rubber.model], np.array(rubber.constants), shape.mode, stretch)
    return np.asarray(stress * shape.width * rubber.thickness / GRAVITY * 1e3)


def softened(share: Array, damage: float) -> Array:
    """Load of unloading where that of loading had a share of the largest one, relative to that too."""
    return np.asarray(share * (1.0 - damage * np.tanh((1.0 - share) / _SOFTENING)))


def solved(rubber: Rubber, shape: Shape, elements: int = _ELEMENTS) -> Equilibrium:
    """The sheet at each step. A load of unloading stretches it as the larger one did of which it is left over."""
    grams, _ = loads_of(rubber, shape)
    forces, shares = grams * 1e-3 * GRAVITY / rubber.true_thickness, np.linspace(0.0, 1.0, 2001)
    peak = forces[rubber.up]
    forces[rubber.up + 1 :] = peak * np.interp(forces[rubber.up + 1 :] / peak, softened(shares, rubber.damage), shares)
    side = min(shape.width, shape.length) / elements
    x, y = (np.linspace(0.0, length, round(length / side) + 1) for length in (shape.width, shape.length))
    return equilibrium(MODELS[rubber.model], np.array(rubber.constants), (x, y), forces)


class _Scene(NamedTuple):
    """What the photographs of one sheet show. states : at each step, in the left camera's frame"""

    stand: Stand
    shape: Shape
    speckles: Speckles
    states: Sequence[Sheet]
    noise: float
    seed: Sequence[int]

    @property
    def extent(self) -> Extent:
        """Of the sheet at rest."""
        return Extent(-self.shape.width / 2.0, self.shape.width / 2.0, 0.0, self.shape.length)

    def take(self, side: int, step: int) -> Bytes:
        """Take one photograph. side : 0 — left, 1 — right"""
        rig, state = self.stand.rig, self.states[step]
        camera = (rig.left, rig.right)[side]
        seen = state.moved_rigidly(rig.rotation, rig.translation) if side else state
        outline = image_of_sheet(camera, seen, extent_outline(self.extent))
        image = painted(
            camera,
            outline,
            lambda box: trace_sheet(camera, seen, box),
            self.extent,
            lambda points: darkness(self.speckles, points),
            LOOKS[side],
            3,
        )
        return add_noise_and_round(image, self.noise, [*self.seed, side, step])


def write_sheets(
    folder: Path,
    rubber: Rubber,
    shapes: Sequence[str] = tuple(SHAPES),
    scale: float = 1.0,
    boards: int = 20,
    workers: int = 1,
    on_progress: Progress | None = None,
) -> None:
    """Write photographs, boards, weights, regions and truth; the same rubber gives the same bytes.

    scale : of the photographs against 1440 × 1920 px; speckles keep their size in pixels
    boards : number of board pairs
    workers : photographs rendered at once
    """
    size = (round(_PHOTOGRAPH[0] * scale), round(_PHOTOGRAPH[1] * scale))
    stand, pixel = verged_stand(size, _FIELD), _FIELD / size[1]
    board = _BOARD._replace(edge=_BOARD_EDGE_PX * pixel)
    pictures = _boards(stand, board, boards, rubber)
    for name in shapes:
        scene = _scene(stand, rubber, SHAPES[name], pixel, folder / name)
        pictures |= {
            f"{name}/photos/{SIDES[side]}/step_{step:02d}.png": partial(scene.take, side, step)
            for side in (0, 1)
            for step in range(len(scene.states))
        }
    (folder / "truth").mkdir(parents=True, exist_ok=True)
    write_rig(folder / "truth" / "rig.json", stand.rig)
    facts = {**rubber._asdict(), "true_thickness": rubber.true_thickness}
    (folder / "truth" / "rubber.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    write_photographs(folder, pictures, workers, on_progress)


def _boards(stand: Stand, board: Checkerboard, count: int, rubber: Rubber) -> dict[str, Taken]:
    poses = board_poses(stand, board, count, seed=rubber.seed)
    return {
        f"boards/{SIDES[side]}/board_{k:02d}.png": partial(
            take_board, stand.rig, pose, board, side, rubber.noise, [rubber.seed, 1, side, k]
        )
        for side in (0, 1)
        for k, pose in enumerate(poses)
    }


def _scene(stand: Stand, rubber: Rubber, shape: Shape, pixel: float, folder: Path) -> _Scene:
    """What one sheet's photographs show; its tables are written beside them."""
    found, (_, shown) = solved(rubber, shape), loads_of(rubber, shape)
    folder.mkdir(parents=True, exist_ok=True)
    rows = [f"step_{step:02d},{mass:.1f}" for step, mass in enumerate(shown)]
    (folder / "weights.csv").write_text("\n".join(["step,load_g", *rows]) + "\n", encoding="utf-8")
    np.savez_compressed(folder / "truth.npz", allow_pickle=False, **found._asdict())
    size = (shape.width, shape.length)
    diameter = (_SPECKLE_PX[0] * pixel, _SPECKLE_PX[1] * pixel)
    speckles = scatter_speckles(size, diameter, _SPECKLE_EDGE_PX * pixel, seed=rubber.seed)
    poses = _poses(stand, shape, float(found.moved[:, -1, :, 1].max()), len(shown), rubber.seed)
    states = [sheet_between(size, *pair) for pair in zip(found.moved, poses, strict=True)]
    scene = _Scene(stand, shape, speckles, states, rubber.noise, [rubber.seed, round(shape.width), round(shape.length)])
    outline = image_of_sheet(stand.rig.left, states[0], extent_outline(scene.extent, 30))
    (folder / "region.geojson").write_text(outline_text(outline), encoding="utf-8")
    return scene


def _poses(stand: Stand, shape: Shape, pull: float, steps: int, seed: int) -> list[Deformation]:
    """The sheet at rest at every step, in the left camera's frame: hung from its upper edge, swaying a little."""
    rng = np.random.default_rng([seed, 0x57A1, round(shape.width), round(shape.length)])
    upper_edge = np.array([0.0, -0.5 * (shape.length + pull), 0.0])
    found = []
    for step in range(steps):
        turn, shift = (rng.normal(size=3) * float(step > 0) for _ in range(2))
        rest = Deformation(
            shape.length,
            shape.width,
            rotation=rotation_matrix(np.radians(_SWAY_DEG) * turn),
            translation=upper_edge + _SWAY_MM * shift,
        )
        found.append(moved_rigidly(rest, stand.rotation, stand.translation))
    return found
