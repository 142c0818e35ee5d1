"""Products of the precise measurement without any image: points of known fields, exact or with known errors."""

from __future__ import annotations

import numpy as np

from dicflow.core.cameras.camera import Camera, Rig, camera_matrix, project, rotation_matrix, to_right
from dicflow.core.tensors import upper_triangle
from dicflow.engine.product import Product, Variable
from tests.noise import point_errors

SHAPE = (34, 26)
STEP_SIZE = 7
SUBSET_SIZE = 21
MM_PX = 0.05
ORIGIN_PX = (300.0, 200.0)
OWN_MM2 = 1e-6 * np.array([[1.0, 0.2, -0.5], [0.2, 1.5, 0.4], [-0.5, 0.4, 9.0]])
TEMPLATE_PX2 = 0.02**2 * np.array([[1.0, 0.1], [0.1, 0.8]])
SENSITIVITY = MM_PX * np.array([[1.0, 0.1], [0.0, 1.2], [0.9, -0.3]])
RIG = Rig(
    Camera(camera_matrix(10_000.0, (500, 400)), np.zeros(5), (1000, 800)),
    Camera(camera_matrix(10_000.0, (500, 400)), np.zeros(5), (1000, 800)),
    rotation_matrix([0.0, 0.3, 0.0]),
    np.array([-150.0, 0.0, 25.0]),
)
ATTRS = {"step_size": STEP_SIZE, "subset_size": SUBSET_SIZE, "shape_function": "affine"}


def grid_px():
    """The material grid in the left photograph."""
    col, row = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    return np.stack([col, row], axis=-1) * STEP_SIZE + np.array(ORIGIN_PX)


def sheet(slope=(0.0, 0.0)):
    """A plane specimen (row, col, 3) [mm], 500 mm away."""
    x, y = np.moveaxis((grid_px() - [500.0, 400.0]) * MM_PX, -1, 0)
    return np.stack([x, y, 500.0 + slope[0] * x + slope[1] * y], axis=-1)


def points(xyz, rng=None, common=None, sensitivity=SENSITIVITY, scale=1.0):
    """Points of one step; with ``rng`` with errors, whose template part is ``common`` (row, col, 2)."""
    xyz = np.array(xyz, dtype=float)
    if rng is not None:
        xyz += point_errors(rng, SHAPE, scale**2 * OWN_MM2, SUBSET_SIZE, STEP_SIZE)
    if common is not None:
        xyz -= common @ np.asarray(sensitivity).T
    status = np.where(np.isfinite(xyz).all(axis=-1), 0, 4).astype(np.uint8)
    seen = np.stack([project(RIG.left, xyz), project(RIG.right, to_right(RIG, xyz))])
    arrays = {
        "xy": seen[0],
        "xy_right": seen[1],
        "xyz": xyz,
        "covariance": np.broadcast_to(upper_triangle(scale**2 * OWN_MM2), (*SHAPE, 6)),
        "sensitivity": np.broadcast_to(sensitivity, (*SHAPE, 3, 2)),
        "template": np.broadcast_to(upper_triangle(TEMPLATE_PX2), (*SHAPE, 3)),
        "status": status,
        "way": np.ones(SHAPE, np.uint8),
    }
    return Product("points", {name: _variable(values) for name, values in arrays.items()}, ATTRS)


def first_points(xyz, rng=None, common=None):
    """Points of the first step, which lie where the subsets were laid."""
    product = points(xyz, rng, common, sensitivity=0.4 * SENSITIVITY)
    return Product("points", {**product.variables, "xy": _variable(grid_px())}, ATTRS)


def template_errors(rng):
    return point_errors(rng, SHAPE, TEMPLATE_PX2, SUBSET_SIZE, STEP_SIZE)


def correlation(xy, gradient, covariance=(1e-4, 0.0, 1e-4)):
    """Points of one camera."""
    arrays = {
        "xy": np.array(xy, dtype=float),
        "gradient": np.broadcast_to(gradient, (*SHAPE, 2, 2)),
        "covariance": np.broadcast_to(covariance, (*SHAPE, 3)),
        "template": np.broadcast_to(covariance, (*SHAPE, 3)),
        "status": np.zeros(SHAPE, np.uint8),
    }
    return Product("correlation", {name: _variable(values) for name, values in arrays.items()}, ATTRS)


def _variable(values):
    return Variable(("row", "col", "a", "b")[: values.ndim], values)
