"""A scene as a user has it: files of photographs, rig and pipeline, with the settings that ``dicflow init`` writes.

A scene is photographed several times, each with its own draw of the noise, until enough of its points were measured.
"""

from __future__ import annotations

import hashlib
import itertools
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from dicflow.io.rig import write_rig
from dicflow.pipeline import Pipeline, Result
from tests import scenes_in_space
from tests.figures import WORK, made
from tests.scenes_in_space.cameras import LEFT, RIG, SIZE
from tests.scenes_in_space.rendering import exposed, with_noise
from tests.scenes_in_space.specimen import Scene
from tests.scenes_in_space.truth import crack_distance, ring_in_photograph

__all__ = ["draws_of", "measured_results", "write_scene"]

_SUBSET_PX, _STEP_PX = 31, 7
_POINTS, _POINTS_AT_CRACKS = 30_000, 3_000
"""So many points of all draws together, at least, in the region and nearer than one subset to its cracks."""
_SHARED = ("cameras", "pattern", "rendering", "specimen", "gentle", "strip", "tilt")
"""Modules that the photographs of scenes depend on."""
_PIPELINE = """\
dicflow: 1
stages:
  photos: {{stage: images, left: "left_*.{ending}", right: "right_*.{ending}"}}
  rig: {{stage: rig_file, images: photos, file: rig.json}}
  region: {{stage: region, images: photos, polygons: [{{exterior: {outline}, holes: {holes}}}]}}
  features: {{stage: features, images: photos, detector: AKAZE}}
  matches: {{stage: match, images: photos, guided: false, refine: false}}
  correlation: {{stage: correlate, images: photos, subset_size: {subset}, step_size: {step}}}
  stereo: {{stage: stereo, images: photos}}
  points: {{stage: triangulate}}
  frame: {{stage: frame, method: axes, x: {x}, y: {y}, origin: {origin}}}
  total: {{stage: deformation, points: points, window: 50 px}}
"""
_PROBES = """\
  probes: {{stage: probes, total: total, extensometers: {gauges}}}
"""


def draws_of(scene: Scene) -> int:
    """How often a scene is photographed, by the numbers of points that its region and its cracks will have."""
    area = abs(_area(scene, scene.outline)) - sum(abs(_area(scene, ring)) for ring in scene.holes)
    needed = [_POINTS * _STEP_PX**2 / area]
    if scene.cracks:
        grid = np.meshgrid(*(np.arange(0, side, _STEP_PX) for side in SIZE))
        beside = crack_distance(scene, np.stack(grid, axis=-1).reshape(-1, 2)) <= _SUBSET_PX
        needed.append(_POINTS_AT_CRACKS / beside.sum())
    return int(np.ceil(max(needed)))


def _area(scene: Scene, ring: np.ndarray) -> float:
    """Area of a ring of material in the first left photograph, with a sign [px²]."""
    x, y = ring_in_photograph(scene, ring).T
    return float(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def measured_results(name: str, settings: Sequence[str] = ()) -> Iterator[Result | None]:
    """The scene of a name as dicflow measures it, once for each draw; what is in the store is not computed again.

    settings : as after ``--set``, such as ``correlation.shape_function=quadratic``
    Gives None where a run fails, after it has said why.
    """
    scene = scenes_in_space.scene(name)
    draws = draws_of(scene)
    folder = made(f"scenes/{name}_{_digest(name)}_{draws}", lambda path: write_scene(path, scene, range(draws)))
    for draw in range(draws):
        path = folder / str(draw) / "pipeline.yaml"
        path.write_text(_pipeline_text(scene))
        result = Pipeline.load(path, store=WORK / "store_scenes", settings=settings).run()
        assert result.outcome is not None
        print("\n".join(result.outcome.errors), end="\n" * bool(result.outcome.errors), file=sys.stderr)
        yield result if result.outcome.ok else None


def write_scene(folder: Path, scene: Scene, draws: Sequence[int | None]) -> None:
    """Write photographs, rig and pipeline of a scene into folders named after the draws of the noise; None without."""
    for draw in draws:
        (folder / str(draw)).mkdir(parents=True, exist_ok=True)
        write_rig(folder / str(draw) / "rig.json", RIG)
        (folder / str(draw) / "pipeline.yaml").write_text(_pipeline_text(scene))
    for step, side in itertools.product(range(len(scene.loads)), (0, 1)):
        grey = exposed(scene, step, side)
        name = f"{('left', 'right')[side]}_{step:02d}.{_ending(scene)}"
        for draw in draws:
            image = with_noise(grey, scene, None if draw is None else (draw, step, side))
            quality = [cv2.IMWRITE_JPEG_QUALITY, scene.jpeg] if scene.jpeg else []
            cv2.imwrite(str(folder / str(draw) / name), image, quality)


def _ending(scene: Scene) -> str:
    return "jpg" if scene.jpeg else "png"


def _pipeline_text(scene: Scene) -> str:
    def corners(ring: np.ndarray) -> list[list[float]]:
        return ring_in_photograph(scene, ring).round(3).tolist()

    x, y, _ = LEFT.rotation.T.tolist()
    gauges = {name: corners(line) for name, line in scene.gauges.items()}
    return (_PIPELINE + _PROBES * bool(gauges)).format(
        ending=_ending(scene),
        subset=_SUBSET_PX,
        step=_STEP_PX,
        outline=corners(scene.outline),
        holes=[corners(ring) for ring in scene.holes],
        x=x,
        y=y,
        origin=LEFT.translation.tolist(),
        gauges=gauges,
    )


def _digest(name: str) -> str:
    """Digest of the source of a scene, and of what renders it."""
    modules = (*_SHARED, name)
    sources = [Path(__file__).with_name(f"{module}.py").read_bytes() for module in modules]
    return hashlib.sha256(b"".join(sources)).hexdigest()[:12]
