"""What is measured of a plate that only moves: all six degrees of freedom, with the exact and a calibrated rig."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dicflow.engine.product import Product
from dicflow.pipeline import Result
from tests import rigid_scene as scene
from tests.bars import Figure
from tests.figures import made, run_text

FIELD = scene.FIELD_MM[0]
STRAINS = ("exx", "eyy", "gxy")
WAYS = {"": "by default", "_quadratic": "quadratic"}
"""Endings of the stages' names; by default subsets are affine in time and quadratic across."""

EXACT = """\
  correlation{0}: {{stage: correlate, images: photos, step_size: 9{1}}}
  stereo{0}: {{stage: stereo, images: photos, rig: exact, correlation: correlation{0}}}
  points{0}: {{stage: triangulate, rig: exact, correlation: correlation{0}, stereo: stereo{0}}}
  total{0}: {{stage: deformation, rig: exact, points: points{0}}}
"""
TEXT = f"""\
stages:
  photos: {{stage: images, left: "photos/left/*.png", right: "photos/right/*.png"}}
  exact: {{stage: rig_file, file: truth/rig.json, images: photos}}
  boards: {{stage: images, left: "boards/left/*.png", right: "boards/right/*.png"}}
  corners: {{stage: corners, images: boards, size: [{scene.BOARD.columns - 1}, {scene.BOARD.rows - 1}]}}
  rig: {{stage: calibrate, square: {scene.BOARD.square} mm, tangential: true}}
  region: {{stage: region, images: photos, rig: null, rectangle: {list(scene.REGION)}}}
  features: {{stage: features, images: photos, detector: AKAZE}}
  matches: {{stage: match, images: photos, guided: false, refine: false}}
{EXACT.format("", "")}{EXACT.format("_quadratic", ", shape_function: quadratic")}\
  stereo_rig: {{stage: stereo, images: photos, rig: rig, correlation: correlation}}
  points_rig: {{stage: triangulate, rig: rig, correlation: correlation, stereo: stereo_rig}}
  total_rig: {{stage: deformation, rig: rig, points: points_rig}}
"""


class Moved(NamedTuple):
    """What one motion shows; errors along the axes of the stand, Z away from the cameras.

    share : of the region's points that are measured
    errors : (n, 3) of the displacement [µm]
    strains : (3, n) — false ones [µε]
    scaled : (3, n) — the same over their predicted σ
    """

    share: float
    errors: np.ndarray
    strains: np.ndarray
    scaled: np.ndarray

    @property
    def in_plane(self) -> float:
        """Mean length of the error in the plane of the plate at rest [µm]."""
        return float(np.hypot(self.errors[:, 0], self.errors[:, 1]).mean())

    @property
    def out_of_plane(self) -> float:
        """Mean size of the error across it [µm]."""
        return float(np.abs(self.errors[:, 2]).mean())


class Calibrated(NamedTuple):
    """What the calibrated rig adds to one motion, root mean squares over the points.

    extra : difference of the displacement from that with the exact rig [µm]
    predicted : σ of it by the calibration [µm]
    motion : the displacement itself [µm]
    """

    extra: float
    predicted: float
    motion: float


def rigid_motions() -> Iterator[Figure]:
    """Every motion in both ways, and with the rig that the boards give."""
    result = run_text("rigid", TEXT, made("rigid", scene.write_photographs))
    noise = result.product("correlation", 1).attrs["noise_grey"] / np.hypot(scene.NOISE, 12**-0.5)
    name = f"rigid motion, field of view {FIELD:g} mm"
    yield Figure(f"{name}: noise measured in the photographs, over the true one", noise)
    for ending, way in WAYS.items():
        yield from with_exact_rig(f"{name}, {way}", measured(result, ending))
    yield from with_calibrated_rig(name, [added(result, step) for step in result.steps("total")])


def with_exact_rig(name: str, motions: list[Moved]) -> Iterator[Figure]:
    """Errors of displacement, and false strain."""
    print(f"\n{name}: errors, their means and false strain\n{'motion':<14}{'in plane':>9}{'out':>7} µm", end="")
    print(f"{'mean x, y, z':>22} µm{'mean exx, eyy, gxy':>22} µε{'over σ':>8}")
    for motion, found in zip(scene.MOTIONS, motions, strict=True):
        means, strains = (" ".join(f"{v:7.2f}" for v in part) for part in (found.errors.mean(0), found.strains.mean(1)))
        print(f"{motion:<14}{found.in_plane:>9.2f}{found.out_of_plane:>7.2f}    {means:>23}  {strains:>23}", end="")
        print(f"{found.scaled.std():>10.3f}")
    yield Figure(f"{name}: least share of points measured", min(found.share for found in motions))
    for where, errors, share in (
        ("in-plane", [found.in_plane for found in motions], 100_000),
        ("out-of-plane", [found.out_of_plane for found in motions], 50_000),
    ):
        yield Figure(f"{name}: mean {where} error", float(np.mean(errors)), 1e3 * FIELD / share, unit="µm")
        yield Figure("  of the worst motion", max(errors), unit="µm")
    strain = max(float(np.abs(found.strains.mean(axis=1)).max()) for found in motions)
    yield Figure(f"{name}: largest mean of a false strain", strain, 50.0, unit="µε")
    scatter = np.concatenate([found.scaled for found in motions], axis=1).std()
    yield Figure(f"{name}: |scatter of false strain over predicted σ − 1|", abs(float(scatter) - 1.0), 0.1)


def with_calibrated_rig(name: str, motions: list[Calibrated]) -> Iterator[Figure]:
    """What the rig from the boards adds."""
    name += f", rig of {scene.BOARDS} boards"
    print(f"\n{name}: extra error, its predicted σ, and the motion")
    for motion, found in zip(scene.MOTIONS, motions, strict=True):
        print(f"{motion:<14}{found.extra:>8.3f} µm{found.predicted:>8.3f} µm{found.motion:>10.1f} µm")
    share = max(found.extra / found.motion for found in motions)
    yield Figure(f"{name}: largest extra error over the motion", 100.0 * share, 0.03, unit="%")
    ratio = max(found.extra / found.predicted for found in motions)
    yield Figure(f"{name}: largest extra error over its predicted σ", ratio, 2.0)


def measured(result: Result, ending: str) -> list[Moved]:
    """Every motion with the exact rig."""
    places = result.product(f"correlation{ending}", 0)["xy"]
    steps = result.steps(f"total{ending}")
    return [_moved(result.product(f"total{ending}", step), places, k) for k, step in enumerate(steps, start=1)]


def _moved(total: Product, places: np.ndarray, step: int) -> Moved:
    errors = (displacement(total) - scene.displacement_truth(places, step)) @ scene.STAND.rotation
    known = np.isfinite(errors).all(axis=-1)
    strains = np.stack([total[name][known] for name in STRAINS])
    deviations = np.stack([total[f"sigma_{name}"][known] for name in STRAINS])
    share = known.sum() / np.isfinite(places).all(axis=-1).sum()
    return Moved(float(share), 1e3 * errors[known], 1e6 * strains, strains / deviations)


def added(result: Result, step: str) -> Calibrated:
    """One motion with the calibrated rig beside the exact one."""
    exact, found = (result.product(name, step) for name in ("total", "total_rig"))
    motion, extra = displacement(exact), displacement(found) - displacement(exact)
    predicted = np.stack([found[f"calibration_{name}"] for name in "UVW"], axis=-1)
    known = np.isfinite(extra + predicted).all(axis=-1)
    sizes = (np.sqrt((part[known] ** 2).sum(axis=-1).mean()) for part in (extra, predicted, motion))
    return Calibrated._make(1e3 * float(size) for size in sizes)


def displacement(total: Product) -> np.ndarray:
    """(row, col, 3) in the left camera's frame [mm]."""
    return np.stack([total[name] for name in "UVW"], axis=-1)
