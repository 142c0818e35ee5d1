"""What the report measures itself where no stage did: once, and kept from one page to the next."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import NamedTuple

from dicflow.engine.product import Product
from dicflow.kinds.correlation import Correlation
from dicflow.kinds.images import Images
from dicflow.kinds.points import Points
from dicflow.kinds.region import Region
from dicflow.kinds.rig import CalibratedRig
from dicflow.pipeline import Result
from dicflow.report.context import Context

__all__ = ["CameraFacts", "cameras", "pattern", "stand_off_mm"]


class CameraFacts(NamedTuple):
    """What the report says of the calibrated cameras.

    size : (width, height) of their photographs [px]
    focal_px : focal lengths in x of the left and the right one
    """

    size: tuple[int, int]
    focal_px: tuple[float, float]


def cameras(context: Context, stage: str) -> CameraFacts:
    """Facts of a stage that gives a rig, which is in the store."""
    result = context.result

    def made() -> bytes:
        rig = CalibratedRig.read(result.product(stage)).cameras
        focal = [float(camera.matrix[0, 0]) for camera in (rig.left, rig.right)]
        return json.dumps([rig.left.size, focal]).encode()

    (width, height), (left, right) = json.loads(context.pieces.get(["cameras", result.digest(stage)], made))
    return CameraFacts((width, height), (left, right))


def pattern(context: Context) -> Mapping[str, float | None] | None:
    """The speckle pattern of the first photograph inside the region, as its correlation found it, else measured here.

    Has the fields of :class:`dicflow.core.photographs.pattern.Pattern`, None for an unknown one. All is None without a
    region, or where the store keeps no photograph.
    """
    result = context.result
    for stage in result.stages_of("region"):
        images = result.source(stage, "images")
        if (kept := _kept_pattern(result, stage, images)) is not None:
            return kept
        if result.has(stage) and result.has(images, 0):
            sources = ["pattern", result.digest(stage), result.digest(images, 0)]
            image, region = result.product(images, 0), result.product(stage)
            found = context.piece(sources, lambda: _measured(image, region))  # noqa: B023
            return None if found is None else json.loads(found)
    return None


def stand_off_mm(context: Context) -> float | None:
    """Median distance of the measured points in front of the left camera at the first step."""
    result = context.result
    stages = [stage for kind in ("points", "cloud") for stage in reversed(result.stages_of(kind))]
    places = ((stage, step) for stage in stages for step in result.steps(stage) if result.has(stage, step))
    stage, step = next(places, ("", ""))
    if not stage:
        return None
    if result.kind(stage) == "points" and (depth := Points.read(result.product(stage, step)).depth_mm) is not None:
        return depth
    sources = ["stand-off", result.arrays(stage, step)["xyz"].digest]
    found = context.piece(sources, lambda: _median_depth(result.product(stage, step)))
    return None if found is None else json.loads(found)


def _kept_pattern(result: Result, region: str, images: str) -> Mapping[str, float | None] | None:
    """What a correlation found of the pattern inside a region of some images; None without any."""
    for stage in result.stages_of("correlation"):
        sources = result.source(stage, "region"), result.source(stage, "images")
        if sources == (region, images) and result.has(stage, 0):
            return Correlation.read(result.product(stage, 0)).pattern
    return None


def _measured(image: Product, region: Product) -> bytes:
    from dicflow.core.photographs.pattern import pattern_of
    from dicflow.core.photographs.region import interior

    left = Images.read(image).left
    found = pattern_of(left, interior(Region.read(region).polygons, left.shape))._asdict()
    return json.dumps({name: value if value == value else None for name, value in found.items()}).encode()


def _median_depth(points: Product) -> bytes:
    import numpy as np

    depth = points["xyz"][..., 2]
    depth = depth[np.isfinite(depth)]
    return json.dumps(float(np.median(depth)) if depth.size else None).encode()
