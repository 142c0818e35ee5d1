"""What a stereo step costs: photographs of 5 Mpx, followed, matched, triangulated, with strain and uncertainties."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np

from dicflow.core.synthetic.deformation import Deformation, moved_rigidly
from dicflow.core.synthetic.render import GreyLevels, add_noise_and_round, render_strip
from dicflow.core.synthetic.speckle import scatter_speckles
from dicflow.core.synthetic.stand import in_right_frame, verged_stand
from dicflow.io.rig import write_rig
from dicflow.pipeline import Pipeline
from tests.bars import Figure
from tests.figures import WORK, forth_and_back, fresh

SIZE, FIELD_MM = (2448, 2048), 100.0
WIDTH, LENGTH = 64.0, 70.0
STRETCHES = (1.0, 1.01, 1.02, 1.03)
PIPELINE = """\
dicflow: 1
title: a strip at 5 Mpx
stages:
  photos: {stage: images, left: "left/*.png", right: "right/*.png"}
  rig: {stage: rig_file, file: rig.json, images: photos}
  region: {stage: region, images: photos, file: region.geojson}
  correlation: {stage: correlate, images: photos, subset_size: 33, step_size: 10}
  stereo: {stage: stereo, images: photos}
  points: {stage: triangulate}
  total: {stage: deformation, points: points, window: 70 px}
"""


def photographs() -> None:
    """The photographs, the rig and the region, rendered at the first call."""
    folder = WORK / "strip_5_mpx"
    if not (folder / "pipeline.yaml").is_file():
        stand = verged_stand(SIZE, FIELD_MM)
        speckles = scatter_speckles((WIDTH, LENGTH), (0.2, 0.32), 0.11, seed=4)
        for step, stretch in enumerate(STRETCHES):
            plain = Deformation(LENGTH, WIDTH, stretch, curl=0.2)
            centred = moved_rigidly(plain, np.eye(3), np.array([0.0, -stretch * LENGTH / 2.0, 0.0]))
            left = moved_rigidly(centred, stand.rotation, stand.translation)
            views = {"left": (stand.rig.left, left), "right": (stand.rig.right, in_right_frame(stand.rig, left))}
            for side, (camera, seen) in views.items():
                (folder / side).mkdir(parents=True, exist_ok=True)
                image = add_noise_and_round(
                    render_strip(camera, seen, speckles, 1.0, GreyLevels()), 2.0, [step, side == "right"]
                )
                cv2.imwrite(str(folder / side / f"step_{step}.png"), image)
        write_rig(folder / "rig.json", stand.rig)
        (folder / "region.geojson").write_text(json.dumps(_region()))
        (folder / "pipeline.yaml").write_text(PIPELINE)


def _region() -> dict[str, Any]:
    """1,200 × 1,000 px in the middle of the photograph."""
    x0, y0, x1, y1 = (SIZE[0] - 1200) // 2, (SIZE[1] - 1000) // 2, (SIZE[0] + 1200) // 2, (SIZE[1] + 1000) // 2
    ring = [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]
    geometry = {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "properties": {"frame": "photograph"}, "geometry": geometry}


def step_cost() -> Iterator[Figure]:
    """Time that one more step of 12,000 points takes in a run with two workers, from runs of two lengths."""
    photographs()
    seconds = {}
    for count in (4, 12):
        pipeline = Pipeline.load(_of_length(count), store=fresh(f"store_5_mpx_{count}"))
        result = pipeline.run(workers=2)
        assert result.outcome is not None
        if not result.outcome.ok:
            sys.exit("\n".join(result.outcome.errors))
        seconds[count] = result.outcome.seconds
    last = result.product("total", result.steps("total")[-1])
    yield Figure("stereo step at 5 Mpx: points", int(np.isfinite(last["eyy"]).sum()), 11_500, at_least=True)
    yield Figure("stereo step at 5 Mpx: each further one", (seconds[12] - seconds[4]) / 8, 1.0, unit="s")


def _of_length(steps: int) -> str:
    """The same photographs forth and back, as hard links; returns the pipeline's file."""
    source, folder = WORK / "strip_5_mpx", fresh(f"strip_5_mpx_{steps}")
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
        for step, path in enumerate(forth_and_back(sorted((source / side).glob("*.png")), steps)):
            os.link(path, folder / side / f"step_{step:02}.png")
    for name in ("rig.json", "region.geojson", "pipeline.yaml"):
        os.link(source / name, folder / name)
    return str(folder / "pipeline.yaml")
