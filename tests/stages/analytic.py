"""Tracks and clouds of a plane specimen in homogeneous deformation, without any image: exact to rounding."""

from __future__ import annotations

import numpy as np

from dicflow.core.matching.transform import apply_transform
from dicflow.core.photographs.region import carry, rectangle
from dicflow.core.strain.surface_strain import deformation_gradient, engineering_strain
from dicflow.engine.product import Product, Variable
from dicflow.kinds.region import polygons_to_json

SCALE = 0.1
"""Millimetres per pixel of a camera without perspective."""
BOX = (40.0, 40.0, 100.0, 160.0)
"""The region at the first step [px]."""
STEP_SIZE = 5.0
SUBSETS = (3, 3)
SHAPE = (330, 150)


def affine(xx=1.0, xy=0.0, yx=0.0, yy=1.0, shift=(0.0, 0.0)):
    """Transform of the image that leaves the middle of the region's upper edge in place, but for the shift."""
    linear, fixed = np.array([[xx, xy], [yx, yy]]), np.array([70.0, 40.0])
    transform = np.eye(3)
    transform[:2, :2], transform[:2, 2] = linear, fixed - linear @ fixed + shift
    return transform


def cloud(plane=(0.0, 0.0), z=500.0, status=0, shape=SHAPE):
    """The plane Z = z + a X + b Y at every pixel."""
    row, col = np.mgrid[: shape[0], : shape[1]] * SCALE
    xyz = np.stack([col, row, z + plane[0] * col + plane[1] * row], axis=-1)
    variables = {
        "xyz": Variable(("row", "col", "component"), xyz, "mm"),
        "status": Variable(("row", "col"), np.full(shape, status, np.uint8)),
    }
    return Product("cloud", variables, {"origin": [0.0, 0.0]})


def track(total, before=None):
    """The material grid of the region carried by a transform from the first step."""
    x0, y0, x1, y1 = BOX
    half = STEP_SIZE / 2
    grid = np.stack(np.meshgrid(np.arange(x0 + half, x1, STEP_SIZE), np.arange(y0 + half, y1, STEP_SIZE)), axis=-1)
    points = apply_transform(total, grid.reshape(-1, 2)).reshape(grid.shape)
    step = total @ np.linalg.inv(total if before is None else before)
    region = carry([rectangle(*BOX)], lambda ring: apply_transform(total, ring))
    variables = {
        "points": Variable(("row", "col", "component"), points, "px"),
        "status": Variable(("row", "col"), np.zeros(grid.shape[:2], np.uint8)),
        "transforms": Variable(("subset_row", "subset_col", "i", "j"), np.broadcast_to(step, (*SUBSETS, 3, 3))),
    }
    return Product("track", variables, {"polygons": polygons_to_json(region, 9), "step_size": STEP_SIZE})


def tracks(totals):
    return [track(total, totals[max(index - 1, 0)]) for index, total in enumerate(totals)]


def true_strain(total, plane=(0.0, 0.0)):
    """Gradient and engineering strain of an image's affine transform on the plane."""
    before = np.array([[1.0, 0.0], [0.0, 1.0], plane])
    gradient = deformation_gradient(before, before @ total[:2, :2])
    return gradient, engineering_strain(gradient)


def run_all(totals, clouds=None, definition="material", smooth=False, window=(40, 20)):
    """Increments, strains and totals of a test through the stages."""
    from dicflow.stages.accumulate import Accumulate
    from dicflow.stages.displacement import Displacement
    from dicflow.stages.smooth import Smooth
    from dicflow.stages.strain import Strain

    steps, results, total = tracks(totals), [], None
    for k in range(1, len(steps)):
        pair = {} if clouds is None else {"cloud": clouds[k], "cloud_before": clouds[k - 1]}
        increment = Displacement(definition=definition).run(track=steps[k], track_before=steps[k - 1], **pair)
        if smooth:
            increment = Smooth(window=window).run(increment=increment)
        strain = Strain(window=window).run(increment=increment)
        total = Accumulate().run(strain=strain, total_before=total)
        results.append((increment, strain, total))
    return results
