"""What good and bad photographs do to a measurement: rendered, measured, and set as tables of the manual."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple

import cv2
import numpy as np

import dicflow
from dicflow.core.synthetic.planar import planar_pair
from dicflow.errors import StageError

__all__ = ["SCENES", "Measured", "advice_table", "measured", "picture"]

SIZE = (240, 220)
OUTLINE = [[30, 30], [210, 30], [210, 190], [30, 190]]
STRETCH = np.array([[1.01, 0.0, 0.33], [0.0, 0.997, 0.33], [0.0, 0.0, 1.0]])
_CROP, _ZOOM = 80, 3
Change = Callable[[np.ndarray], np.ndarray]


class Scene(NamedTuple):
    """Two photographs of speckles.

    title : what is good or bad of them
    diameter : of the speckles, least and greatest [px]
    noise : standard deviation of the grey levels
    change : of both photographs; only of the second one if ``second_only``
    """

    title: str
    diameter: tuple[float, float] = (3.0, 7.0)
    noise: float = 1.0
    change: Change = lambda image: image
    second_only: bool = False


class Measured(NamedTuple):
    """Root mean square error of the displacement [px], and the share of the points with a value."""

    error_px: float
    found: float


def _contrast(factor: float) -> Change:
    return lambda image: np.clip(128 + factor * (image.astype(float) - 128), 0, 255).astype(np.uint8)


def _glare(image: np.ndarray) -> np.ndarray:
    return np.asarray(cv2.circle(image.copy(), (150, 100), 40, 255, -1))


def _defocus(sigma: float) -> Change:
    return lambda image: np.asarray(cv2.GaussianBlur(image, (0, 0), sigma))


def _shaken(image: np.ndarray) -> np.ndarray:
    return np.asarray(cv2.blur(image, (7, 1)))


def _brighter(image: np.ndarray) -> np.ndarray:
    return np.clip(1.6 * image.astype(float), 0, 255).astype(np.uint8)


SCENES: Mapping[str, tuple[Scene, ...]] = {
    "pattern": (
        Scene("speckles of 3 to 7 px"),
        Scene("too fine: 1 to 1.5 px", (1.0, 1.5)),
        Scene("too coarse: 20 to 30 px", (20.0, 30.0)),
        Scene("too pale: a tenth of the contrast", noise=10.0, change=_contrast(0.1)),
    ),
    "light": (
        Scene("bright and even, low ISO"),
        Scene("high ISO: noise of 8 grey levels", noise=8.0),
        Scene("glare in the second photograph", change=_glare, second_only=True),
        Scene("overexposed: the paper is clipped", change=_brighter),
    ),
    "camera": (
        Scene("in focus, at rest"),
        Scene("out of focus by 3 px", change=_defocus(3.0)),
        Scene("out of focus in the second photograph", change=_defocus(1.5), second_only=True),
        Scene("shaken by 7 px in the second photograph", change=_shaken, second_only=True),
    ),
}


def photographs(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Both photographs of a scene."""
    pair = planar_pair(SIZE, STRETCH, diameter=scene.diameter, noise=scene.noise, seed=7)
    first = pair.reference if scene.second_only else scene.change(pair.reference)
    return first, scene.change(pair.deformed)


@cache
def measured(scene: Scene) -> Measured:
    """What dicflow's defaults make of a scene."""
    try:
        total = dicflow.measure(photographs(scene), region=[OUTLINE]).dataset("total", 0)
    except StageError:
        return Measured(float("nan"), 0.0)
    places = np.stack(np.broadcast_arrays(total.x_px.values, total.y_px.values[:, None]), -1)
    truth = places @ (STRETCH[:2, :2] - np.eye(2)).T + STRETCH[:2, 2]
    errors = np.stack([total.U, total.V], -1) - truth
    known = np.isfinite(errors).all(-1)
    return Measured(float(np.sqrt((errors[known] ** 2).mean())), float(known.mean()))


def picture(scene: Scene) -> bytes:
    """The second photograph, a part of it enlarged, as PNG."""
    part = photographs(scene)[1][60 : 60 + _CROP, 110 : 110 + _CROP]
    enlarged = cv2.resize(part, None, fx=_ZOOM, fy=_ZOOM, interpolation=cv2.INTER_NEAREST)
    return bytes(cv2.imencode(".png", enlarged)[1].tobytes())


def advice_table(subject: str) -> tuple[str, dict[str, bytes]]:
    """Markdown of the scenes of a subject side by side, and the pictures: path below ``docs`` → PNG."""
    scenes = SCENES[subject]
    names = {f"pictures/advice_{subject}_{k}.png": scene for k, scene in enumerate(scenes)}
    rows: list[list[Any]] = [
        [scene.title for scene in scenes],
        [f"![{scene.title}]({name})" for name, scene in names.items()],
        [_figures(measured(scene)) for scene in scenes],
    ]
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(scenes), *lines[1:]]), {n: picture(s) for n, s in names.items()}


def _figures(one: Measured) -> str:
    if not one.found:
        return "nothing found"
    return f"error {one.error_px:.4f} px, found {100 * one.found:.0f} %"
