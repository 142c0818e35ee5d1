"""The product ``correlation`` of a few steps, from given starts, without any search."""

from __future__ import annotations

import numpy as np

from dicflow.core.correlation.judgement import find_points
from dicflow.core.correlation.points import VIA_REFERENCE_STEP, ReferencePhotograph
from dicflow.core.correlation.search import Search
from dicflow.core.correlation.subsets import Subset, correlate
from dicflow.core.correlation.template import template
from dicflow.core.correlation.warp import identity
from dicflow.core.photographs.exposure import Photograph
from dicflow.core.photographs.interpolate import spline
from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import rasterise, rectangle
from dicflow.core.status import Status
from dicflow.core.tensors import congruent
from dicflow.engine.product import Product, Variable
from dicflow.kinds.correlation import reference_variables
from dicflow.kinds.region import polygons_to_json

SUBSET = Subset(31, "quadratic")
_ARRAYS = {"route": "way", "template_covariance": "template", "inherited_covariance": "passed"}
"""Names of fields in the product, where they differ."""


def grid(region: tuple[float, float, float, float], step_size: int) -> np.ndarray:
    """Whole pixels (row, col, 2) of a rectangle (x0, y0, x1, y1)."""
    x0, y0, x1, y1 = region
    return np.stack(np.meshgrid(np.arange(x0, x1, step_size), np.arange(y0, y1, step_size)), axis=-1)


def correlation(
    first: np.ndarray,
    image: np.ndarray | None,
    points: np.ndarray,
    starts: np.ndarray | None = None,
    *,
    subset: Subset = SUBSET,
    noise: float = 0.5,
    region: list[Polygon] | None = None,
) -> Product:
    """Points (row, col, 2) of the first photograph in another one; in itself where none is given.

    starts : (row, col, 2) — about where they lie there [px]
    """
    rows, cols = points.shape[:2]
    height, width = first.shape
    polygons = region or [rectangle(0, 0, width, height)]
    reference = template(spline(first, 5), rasterise(polygons, first.shape))
    flat = points.reshape(-1, 2)
    begin = identity(flat, subset.shape_function)
    known = np.isfinite(flat).all(axis=1)
    if starts is not None:
        begin[..., 0] = starts.reshape(-1, 2)
    target = spline(first if image is None else image, 5)
    found = correlate(reference, target, np.nan_to_num(flat), np.where(known[:, None, None], begin, np.nan), subset)
    warp, status = found.warp, found.status
    own = 0.5 * noise**2 * found.covariance
    gradient = warp[:, :, 1:3]
    inverse = np.full(gradient.shape, np.nan)
    valid = status == Status.VALID
    inverse[valid] = np.linalg.inv(gradient[valid])
    share = congruent(inverse, own)
    if image is None:
        warp = np.where(valid[:, None, None], identity(flat, subset.shape_function), np.nan)
        own = np.zeros_like(own)
    status = np.where(known, status, Status.OUTSIDE).astype(np.uint8)
    arrays = {
        "xy": warp[:, :, 0],
        "gradient": warp[:, :, 1:3],
        "znssd": found.znssd,
        "iterations": found.iterations,
        "status": status,
        "covariance": own,
        "template": share,
        "way": np.full(len(flat), 0 if image is None else 1, np.uint8),
        "warp": warp,
        "passed": 0.0 * own,
        "misfit": 0.0 * own,
        "slope": warp[:, :, 1:3],
    }
    variables = {
        name: Variable(("row", "col", "a", "b")[: values.ndim + 1], values.reshape(rows, cols, *values.shape[1:]))
        for name, values in arrays.items()
    }
    attrs = {
        "step_size": float(points[0, 1, 0] - points[0, 0, 0]),
        "subset_size": subset.size,
        "shape_function": subset.shape_function,
        "image_size": [width, height],
        "noise_grey": noise,
        "noise_level": noise,
        "noise_source": "photograph",
        "noise_settled": True,
        "polygons": polygons_to_json(polygons),
    }
    return Product("correlation", variables, attrs)


def through_reference(between: Product, photograph: np.ndarray, image: np.ndarray, starts: np.ndarray) -> Product:
    """Points in another photograph by way of one in between.

    between, photograph : the product of the step in between, and its left photograph
    starts : (row, col, 2) — about where the points lie in the image [px]
    """
    facts = between.attrs
    search = Search(Subset(facts["subset_size"], facts["shape_function"]), noise=facts["noise_grey"])
    everywhere = np.ones(photograph.shape, dtype=bool)
    known = (between[name] for name in ("xy", "warp", "passed", "slope"))
    reference_step = ReferencePhotograph(Photograph(photograph), (0, 0), everywhere, *known)
    begin = np.concatenate([starts[..., None], between["gradient"]], axis=-1)
    found = find_points(reference_step, spline(image, 5), begin, search, VIA_REFERENCE_STEP)
    carried, reference = reference_variables(reference_step, facts["subset_size"])
    arrays = {
        "xy": found.warp[..., 0],
        "gradient": found.warp[..., 1:3],
        **{_ARRAYS.get(name, name): values for name, values in found._asdict().items()},
        "template": between["template"],
    }
    variables = {name: Variable(("row", "col", "a", "b")[: v.ndim], v) for name, v in arrays.items()}
    return Product("correlation", variables | carried, {**facts, **reference})
