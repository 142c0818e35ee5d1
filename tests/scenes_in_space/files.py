"""A scene as a user has it: files of photographs, rig and pipeline, with the settings that ``dicflow init`` writes."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from dicflow.io.rig import write_rig
from dicflow.pipeline import Pipeline, Result
from tests import scenes_in_space
from tests.figures import WORK, made
from tests.scenes_in_space.cameras import LEFT, RIG
from tests.scenes_in_space.rendering import photographs
from tests.scenes_in_space.specimen import Scene
from tests.scenes_in_space.truth import ring_in_photograph

__all__ = ["measured_result", "write_scene"]

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
  correlation: {{stage: correlate, images: photos, subset_size: 31, step_size: 7}}
  stereo: {{stage: stereo, images: photos}}
  points: {{stage: triangulate}}
  frame: {{stage: frame, method: axes, x: {x}, y: {y}, origin: {origin}}}
  total: {{stage: deformation, points: points, window: 50 px}}
"""
_PROBES = """\
  probes: {{stage: probes, total: total, extensometers: {gauges}}}
"""


def measured_result(name: str, settings: Sequence[str] = ()) -> Result | None:
    """The scene of a name as dicflow measures it; what is in the store is not computed again.

    settings : as after ``--set``, such as ``correlation.shape_function=quadratic``
    Returns None where the run fails, after it has said why.
    """
    scene = scenes_in_space.scene(name)
    folder = made(f"scenes/{name}_{_digest(name)}", lambda path: write_scene(path, scene))
    path = folder / "pipeline.yaml"
    path.write_text(_pipeline_text(scene))
    result = Pipeline.load(path, store=WORK / "store_scenes", settings=settings).run()
    assert result.outcome is not None
    print("\n".join(result.outcome.errors), end="\n" * bool(result.outcome.errors), file=sys.stderr)
    return result if result.outcome.ok else None


def write_scene(folder: Path, scene: Scene, seed: int = 0, noisy: bool = True) -> None:
    """Write photographs, rig and pipeline of a scene into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for step in range(len(scene.loads)):
        for side, image in zip(("left", "right"), photographs(scene, step, seed, noisy), strict=True):
            name = f"{side}_{step:02d}.{_ending(scene)}"
            cv2.imwrite(str(folder / name), image, [cv2.IMWRITE_JPEG_QUALITY, scene.jpeg] if scene.jpeg else [])
    write_rig(folder / "rig.json", RIG)
    (folder / "pipeline.yaml").write_text(_pipeline_text(scene))


def _ending(scene: Scene) -> str:
    return "jpg" if scene.jpeg else "png"


def _pipeline_text(scene: Scene) -> str:
    def corners(ring: np.ndarray) -> list[list[float]]:
        return ring_in_photograph(scene, ring).round(3).tolist()

    x, y, _ = LEFT.rotation.T.tolist()
    gauges = {name: corners(line) for name, line in scene.gauges.items()}
    return (_PIPELINE + _PROBES * bool(gauges)).format(
        ending=_ending(scene),
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
