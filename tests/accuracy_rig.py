"""Rigs whose cameras were bumped, refined from photographs: places and displacements against their uncertainty."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dicflow.core.cameras.camera import Rig
from dicflow.core.cameras.rig_parameters import rig_after_step
from dicflow.core.cameras.triangulate import triangulate
from dicflow.core.synthetic.deformation import position
from dicflow.core.synthetic.trace import material_at
from dicflow.core.tensors import symmetric
from dicflow.engine.product import Product
from dicflow.io.rig import write_rig
from dicflow.kinds.rig import CalibratedRig
from dicflow.pipeline import Result
from tests import rigid_scene as scene
from tests.bars import Figure
from tests.data_folder import SHARED
from tests.figures import WORK, made, run_text

QUANTITIES = "XYZUVW"
TURN_DEG, SHIFT_MM = 0.1, 0.5
BUMPS = {
    "none": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "about x": ((TURN_DEG, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "about y": ((0.0, TURN_DEG, 0.0), (0.0, 0.0, 0.0)),
    "about z": ((0.0, 0.0, TURN_DEG), (0.0, 0.0, 0.0)),
    "along x": ((0.0, 0.0, 0.0), (SHIFT_MM, 0.0, 0.0)),
    "along y": ((0.0, 0.0, 0.0), (0.0, SHIFT_MM, 0.0)),
    "along z": ((0.0, 0.0, 0.0), (0.0, 0.0, SHIFT_MM)),
    "all": ((0.06, -0.05, 0.06), (-0.3, 0.3, 0.25)),
}
"""Turn [deg] of the right camera about its own axes, and shift [mm] along them, since the calibration."""

CALIBRATED = f"""\
stages:
  boards: {{stage: images, left: "boards/left/*.png", right: "boards/right/*.png"}}
  corners: {{stage: corners, size: [{scene.BOARD.columns - 1}, {scene.BOARD.rows - 1}]}}
  rig: {{stage: calibrate, square: {scene.BOARD.square} mm, tangential: true}}
"""
PIPELINE = """\
stages:
  photos: {{stage: images, left: {left}, right: {right}}}
  calibrated: {{stage: rig_file, file: {file}}}
  region: {{stage: region{region}}}
  correlation: {{stage: correlate, step_size: {step}}}
{refined}\
  stereo: {{stage: stereo}}
  points: {{stage: triangulate}}
  total: {{stage: deformation, points: points}}
"""
REFINE = "  refined: {stage: refine}\n"


class Measured(NamedTuple):
    """Places and displacements (6, n) at one step [mm], their errors, and the standard deviations stated."""

    errors: np.ndarray
    sigma: np.ndarray


def bumped_rigs() -> Iterator[Figure]:
    """Every bump of the rendered stand, then turns of a real one."""
    yield from rendered()
    if SHARED.is_dir():
        yield from d_specimen()


def rendered() -> Iterator[Figure]:
    """A plate before a rig that was calibrated with noisy boards before the right camera moved."""
    folder = made("rigid", scene.write_photographs)
    rig = CalibratedRig.read(run_text("rigid_boards", CALIBRATED, folder).product("rig"))
    print("\nbumped rigs, rendered: root mean square error before and after refining, and σ stated [µm]")
    worst = []
    for name, bump in BUMPS.items():
        before = bumped(rig.cameras, *bump)
        result = run_text("bumped", _text(name, before, rig.covariance), folder)
        found = Measured(*map(np.concatenate, zip(*_steps(result), strict=True)))
        worst.append(_print(name, _unmended(result, before), found))
        print(f"{'':12}{CalibratedRig.read(result.product('refined')).verdict}")
    ratios = np.array(worst)
    for quantity, ratio in zip(QUANTITIES, ratios.max(axis=0), strict=True):
        yield Figure(f"bumped rig, rendered: largest error of {quantity} over its σ", float(ratio), 2.0)


def _text(name: str, rig: Rig, covariance: np.ndarray | None) -> str:
    file = WORK / f"bump_{name.replace(' ', '_')}.json"
    write_rig(file, rig, covariance)
    region = f", rectangle: {list(scene.REGION)}"
    sides = {"left": '"photos/left/*.png"', "right": '"photos/right/*.png"'}
    return PIPELINE.format(**sides, file=file, region=region, step=24, refined=REFINE)


def bumped(rig: Rig, turn_deg: tuple[float, ...], shift: tuple[float, ...]) -> Rig:
    """The rig as it was before its right camera turned about its own centre, and was shifted."""
    turn = np.radians(turn_deg)
    return rig_after_step(rig, -np.concatenate([np.zeros(18), turn, np.cross(turn, rig.translation) + shift]))


def _steps(result: Result) -> Iterator[Measured]:
    for number, step in enumerate(result.steps("total"), start=1):
        total, places = result.product("total", step), result.product("correlation", 0)["xy"]
        yield _errors(total, _truth(places, number))


def _truth(places: np.ndarray, step: int) -> np.ndarray:
    """X, Y, Z, U, V, W (row, col, 6) of what the first left photograph shows at places, at a step."""
    material = material_at(scene.STAND.rig.left, scene.REST, places, (0.0, scene.PLATE.length / 2.0))
    before, after = position(scene.REST, material), position(scene.STATES[step], material)
    return np.concatenate([after, after - before], axis=-1)


def _errors(total: Product, truth: np.ndarray) -> Measured:
    errors = values(total) - truth
    noise = np.sqrt(np.diagonal(symmetric(total["covariance"])[..., :3, :3], axis1=-2, axis2=-1))
    noise = np.concatenate([noise, _stacked(total, "sigma_")], axis=-1)
    sigma = np.hypot(noise, np.concatenate([total["calibration_xyz"], _stacked(total, "calibration_")], axis=-1))
    known = np.isfinite(errors + sigma).all(axis=-1)
    return Measured(errors[known], sigma[known])


def values(total: Product) -> np.ndarray:
    """X, Y, Z, U, V, W (row, col, 6) of a total [mm]."""
    return np.concatenate([total["xyz"], _stacked(total, "")], axis=-1)


def _stacked(total: Product, prefix: str) -> np.ndarray:
    return np.stack([total[f"{prefix}{name}"] for name in "UVW"], axis=-1)


def _unmended(result: Result, rig: Rig) -> np.ndarray:
    """Root mean square errors (6,) with the rig as it was calibrated, at the last step [mm]."""
    steps = result.steps("correlation")
    pixels = [
        [result.product(stage, step)["xy"] for stage in ("correlation", "stereo")] for step in (steps[0], steps[-1])
    ]
    before, after = (triangulate(rig, *pair).xyz for pair in pixels)
    errors = np.concatenate([after, after - before], axis=-1) - _truth(pixels[0][0], len(steps) - 1)
    return np.sqrt(np.nanmean(errors**2, axis=(0, 1)))


def _print(name: str, before: np.ndarray | None, found: Measured) -> np.ndarray:
    """Print a bump; returns the errors over their σ, root mean squares (6,) of both."""
    after, stated = (np.sqrt((part**2).mean(axis=0)) for part in found)
    print(f"{name:12}{'':8}" + "".join(f"{quantity:>9}" for quantity in QUANTITIES))
    for label, values in (("before", before), ("refined", after), ("σ", stated)):
        if values is not None:
            print(f"{'':12}{label:8}" + "".join(f"{1e3 * value:9.1f}" for value in values))
    return np.asarray(after / stated)


def d_specimen() -> Iterator[Figure]:
    """A real steel part with a real rig, turned by 0.1° about each axis, against the rig as it is."""
    folder = SHARED / "d_specimen"
    given = PIPELINE.format(
        left="[left/GT4-0000_0.tif, left/GT4-0273_0.tif]",
        right="[right/GT4-0000_1.tif, right/GT4-0273_1.tif]",
        file="reference/points_0273_rig.yaml",
        region="",
        step=14,
        refined="",
    )
    reference = run_text("d_bumped", given, folder)
    rig = CalibratedRig.read(reference.product("calibrated"))
    true = values(reference.product("total", -1))
    print("\nd specimen with its rig turned: difference from the rig as it is, and σ stated [µm]")
    worst = []
    for name in ("none", "about x", "about y", "about z"):
        bump = BUMPS[name]
        file = WORK / f"d_{name.replace(' ', '_')}.json"
        write_rig(file, bumped(rig.cameras, *bump))
        text = given.replace("reference/points_0273_rig.yaml", str(file)).replace("  stereo:", f"{REFINE}  stereo:")
        result = run_text("d_bumped", text, folder)
        found = _errors(result.product("total", -1), true)
        worst.append(_print(name, None, found))
        print(f"{'':12}{CalibratedRig.read(result.product('refined')).verdict}")
    for quantity, ratio in zip(QUANTITIES, np.max(worst, axis=0), strict=True):
        yield Figure(f"d specimen, rig turned: largest difference in {quantity} over its σ", float(ratio), 2.0)
