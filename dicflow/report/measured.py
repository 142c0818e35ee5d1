"""What the report measures itself: once, and kept from one page to the next."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import NamedTuple

from dicflow.engine.product import Product
from dicflow.kinds.images import Images
from dicflow.kinds.region import Region
from dicflow.kinds.rig import CalibratedRig
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
    """The speckle pattern of the first photograph inside the region.

    Has ``size_px`` of the speckles, ``gradient`` [grey levels of 255 per px], ``contrast`` and the share that is
    ``saturated``, None for an unknown one. All is None without a region, or where the store keeps no photograph.
    """
    result = context.result
    for stage in result.stages_of("region"):
        images = result.source(stage, "images")
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
    sources = ["stand-off", result.arrays(stage, step)["xyz"].digest]
    found = context.piece(sources, lambda: _median_depth(result.product(stage, step)))
    return None if found is None else json.loads(found)


def _measured(image: Product, region: Product) -> bytes:
    from dicflow.core.photographs.region import interior
    from dicflow.core.photographs.texture import mean_intensity_gradient, saturated_share, speckle_size

    left = Images.read(image).left
    inside = interior(Region.read(region).polygons, left.shape)
    levels = left[inside].astype(float)
    content = {
        "size_px": speckle_size(left, inside),
        "gradient": mean_intensity_gradient(left, inside),
        "contrast": float(levels.std() / max(levels.mean(), 1e-12)),
        "saturated": saturated_share(left, inside),
    }
    return json.dumps({name: value if value == value else None for name, value in content.items()}).encode()


def _median_depth(points: Product) -> bytes:
    import numpy as np

    depth = points["xyz"][..., 2]
    depth = depth[np.isfinite(depth)]
    return json.dumps(float(np.median(depth)) if depth.size else None).encode()
