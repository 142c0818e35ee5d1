"""Pairs of photographs of random hard scenes, with the exact motion: a renderer of its own for validation.

Nothing here is shared with :mod:`dicflow.core.synthetic`. The pattern is a set of soft discs in the material, evaluated
at the place that an exact inverse motion gives for nine points in every pixel. What disturbs the correlation stands in
the camera's frame (glints, shadows, occluders, defocus) or in the material (cracks, flakes of paint).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit

__all__ = ["KINDS", "Scene", "scene"]

WIDTH, HEIGHT = 230, 200
MIDDLE = np.array([WIDTH / 2, HEIGHT / 2])
_REACH, _CELL, _SAMPLES = 60.0, 12.0, 3
"""Margin of the pattern around the photograph, side of the cells that sort its discs [px], and samples per side."""


class Pattern(NamedTuple):
    """Soft discs sorted into square cells.

    discs : (n, 4) — x, y, radius [px] and darkness
    first : (cells + 1,) — index of the first disc of each cell; columns : cells per row
    edge : width of the discs' edges [px]
    """

    discs: np.ndarray
    first: np.ndarray
    columns: int
    edge: float


class Motion(NamedTuple):
    """X = x − shift − slope · (x − middle) − curvature terms, and the jump at a crack.

    curvature : (2, 3) — of xx, xy and yy, in px per (100 px)²
    place, normal : (2,) — a point of the crack [px], and its normal; jump : (2,) opening and slip of one side against
        the other [px]
    """

    shift: np.ndarray
    slope: np.ndarray
    curvature: np.ndarray
    place: np.ndarray
    normal: np.ndarray
    jump: np.ndarray

    def without_crack(self, x: np.ndarray) -> np.ndarray:
        """Material places (..., 2) of places in the target, before the crack."""
        away = (x - MIDDLE) / 100.0
        a, b = away[..., 0], away[..., 1]
        bent = np.stack([a * a, a * b, b * b], axis=-1) @ self.curvature.T
        return x - self.shift - (x - MIDDLE) @ self.slope.T - bent

    def material(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Material places (..., 2) of places (..., 2) in the target, and whether these show the gap of the crack."""
        y = self.without_crack(x)
        distance = (y - self.place) @ self.normal
        opening = float(self.jump @ self.normal)
        side = np.where(distance > 0.0, 0.5, -0.5)
        return y - side[..., None] * self.jump, np.abs(distance) < 0.5 * opening

    def target(self, points: np.ndarray) -> np.ndarray:
        """Places (..., 2) in the target of material points (..., 2)."""
        side = np.where((points - self.place) @ self.normal > 0.0, 0.5, -0.5)
        wanted = points + side[..., None] * self.jump
        x = wanted.copy()
        for _ in range(60):
            x += wanted - self.without_crack(x)
        return x


class Scene(NamedTuple):
    """A reference photograph and a target.

    reference, target : (rows, cols) uint8
    motion : of the material
    hidden : (rows, cols) bool — pixels of the reference photograph whose material one of them does not show
    subset_size : to measure with [px]
    """

    reference: np.ndarray
    target: np.ndarray
    motion: Motion
    hidden: np.ndarray
    subset_size: int


def _pattern(rng: np.random.Generator, size: float) -> Pattern:
    width, height = WIDTH + 2 * _REACH, HEIGHT + 2 * _REACH
    n = int(0.62 * width * height / (np.pi * (0.5 * size) ** 2))
    xy = rng.uniform([-_REACH, -_REACH], [width - _REACH, height - _REACH], (n, 2))
    radius = 0.5 * size * rng.uniform(0.7, 1.3, n)
    columns = int(np.ceil(width / _CELL))
    cell = ((xy + _REACH) // _CELL).astype(int) @ [1, columns]
    order = np.argsort(cell, kind="stable")
    discs = np.column_stack([xy, radius, rng.uniform(0.6, 1.0, n)])[order]
    cells = columns * int(np.ceil(height / _CELL))
    return Pattern(discs, np.searchsorted(cell[order], np.arange(cells + 1)), columns, rng.uniform(0.25, 0.6))


@njit(cache=True)
def _brightness(discs, first, columns, edge, places, out):  # type: ignore[no-untyped-def]
    """Share of light that the pattern reflects at places (n, 2)."""
    rows = (len(first) - 1) // columns
    for k in range(len(places)):
        x, y = places[k]
        j, i = int((x + _REACH) // _CELL), int((y + _REACH) // _CELL)
        light = 1.0
        for a in range(max(i - 1, 0), min(i + 2, rows)):
            for b in range(max(j - 1, 0), min(j + 2, columns)):
                for m in range(first[a * columns + b], first[a * columns + b + 1]):
                    inside = (discs[m, 2] - np.hypot(x - discs[m, 0], y - discs[m, 1])) / edge
                    if inside > -8.0:
                        light *= 1.0 - discs[m, 3] / (1.0 + np.exp(-inside))
        out[k] = light


def _seen(pattern: Pattern, places: np.ndarray) -> np.ndarray:
    out = np.empty(places.shape[:-1])
    _brightness(*pattern, places.reshape(-1, 2), out.reshape(-1))
    return out


def _samples() -> np.ndarray:
    """Places (rows, cols, samples, 2) of the samples of all pixels."""
    within = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
    x, y, dx, dy = np.broadcast_arrays(
        np.arange(WIDTH)[None, :, None, None],
        np.arange(HEIGHT)[:, None, None, None],
        within[None, None, None, :],
        within[None, None, :, None],
    )
    return np.stack([x + dx, y + dy], axis=-1).reshape(HEIGHT, WIDTH, _SAMPLES**2, 2)


_X = np.stack(np.meshgrid(np.arange(WIDTH, dtype=float), np.arange(HEIGHT, dtype=float)), axis=-1)
"""Places (rows, cols, 2) of the pixels."""


class _Pair(NamedTuple):
    """Grey levels of both photographs without noise, and what each does not show of the material."""

    greys: list[np.ndarray]
    hidden: list[np.ndarray]
    motion: Motion
    pattern: Pattern


Change = Callable[[np.random.Generator, _Pair], None]


def _motion(rng: np.random.Generator) -> Motion:
    angle, stretch = np.deg2rad(rng.uniform(-4.0, 4.0)), rng.uniform(-0.02, 0.02, 3)
    slope = np.array([[stretch[0], stretch[2] - angle], [stretch[2] + angle, stretch[1]]])
    curvature = rng.uniform(-0.6, 0.6, (2, 3)) * (rng.random() < 0.5)
    gentle = 1.0 if rng.random() < 0.6 else 0.0
    rest = np.array([0.0, 0.0])
    return Motion(rng.uniform(-7.0, 7.0, 2), gentle * slope, curvature, MIDDLE, np.array([1.0, 0.0]), rest)


def _direction(rng: np.random.Generator) -> np.ndarray:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _somewhere(rng: np.random.Generator, margin: float = 25.0) -> np.ndarray:
    return rng.uniform([margin, margin], [WIDTH - margin, HEIGHT - margin])


def _good(rng: np.random.Generator, pair: _Pair) -> None:
    """Slow changes of the light only."""
    direction, change = _direction(rng), rng.uniform(-0.15, 0.15)
    pair.greys[1] *= 1.0 + rng.uniform(-0.1, 0.1) + change * ((_X - MIDDLE) @ direction) / WIDTH


def _glints(rng: np.random.Generator, pair: _Pair) -> None:
    """Reflections that stand still, or move on their own, with a bright middle and a rim; clipped or not."""
    moves = rng.choice([0.0, 0.0, 2.0, 20.0])
    size, level = rng.uniform(1.5, 9.0), np.exp(rng.uniform(np.log(25.0), np.log(900.0)))
    power = rng.choice([0.5, 1.0, 2.0])
    for _ in range(int(rng.integers(3, 40))):
        at, wide = _somewhere(rng, 10.0), size * rng.uniform(0.5, 1.5, 2)
        axis, bright = _direction(rng), level * rng.uniform(0.4, 1.6)
        for k in (0, 1):
            away = _X - at - k * moves * rng.uniform(-1.0, 1.0, 2)
            a, b = away @ axis, away @ np.array([-axis[1], axis[0]])
            pair.greys[k] += bright * np.exp(-(((a / wide[0]) ** 2 + (b / wide[1]) ** 2) ** power))


def _shadow(rng: np.random.Generator, pair: _Pair) -> None:
    """The edge of a shadow, or of a brighter light, that stands still or wanders or comes with the target."""
    direction, width = _direction(rng), np.exp(rng.uniform(np.log(0.3), np.log(15.0)))
    change, at = rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.7), _somewhere(rng, 50.0)
    way = rng.choice(["still", "wanders", "comes"])
    for k in (0, 1):
        along = (_X - at) @ direction - (k * rng.uniform(-40.0, 40.0) if way == "wanders" else 0.0)
        if k == 1 or way != "comes":
            pair.greys[k] *= 1.0 + change / (1.0 + np.exp(-np.clip(along / width, -60.0, 60.0)))


def _occluder(rng: np.random.Generator, pair: _Pair) -> None:
    """Wires, or a disc or bar, in front of the specimen: dark, bright or speckled; still, or in the target only."""
    look, shape = rng.choice(["dark", "bright", "speckled"]), rng.choice(["wire", "disc", "bar"])
    plain = {"dark": rng.uniform(3.0, 40.0), "bright": rng.uniform(170.0, 240.0), "speckled": 0.0}[look]
    grey = np.full((HEIGHT, WIDTH), plain)
    if look == "speckled":
        grey = 30.0 + 180.0 * _seen(_pattern(rng, rng.uniform(3.0, 8.0)), _X)
    covers = np.zeros((HEIGHT, WIDTH))
    for _ in range(int(rng.integers(1, 4))):
        at, axis, thick = _somewhere(rng), _direction(rng), np.exp(rng.uniform(np.log(1.0), np.log(7.0)))
        away = _X - at
        a, b = np.abs(away @ axis), np.abs(away @ np.array([-axis[1], axis[0]]))
        inside = {
            "wire": 0.5 * thick - a,
            "disc": 1.5 * thick - np.hypot(a, b),
            "bar": np.minimum(thick - a, 3.0 * thick - b),
        }[shape]
        covers = np.maximum(covers, np.clip(inside + 0.5, 0.0, 1.0))
    for k in (0, 1) if rng.random() < 0.6 else (1,):
        pair.greys[k][:] = (1.0 - covers) * pair.greys[k] + covers * grey
        pair.hidden[k] |= covers > 0.0


def _flakes(rng: np.random.Generator, pair: _Pair) -> None:
    """Paint that has come off before the target was taken: plain patches that move with the specimen."""
    grey, (material, _) = rng.uniform(15.0, 230.0), pair.motion.material(_X)
    for _ in range(int(rng.integers(2, 15))):
        at, size = _somewhere(rng), rng.uniform(1.5, 9.0, 2)
        lost = np.clip(1.5 * (1.0 - np.hypot(*np.moveaxis((material - at) / size, -1, 0))) * size.min(), 0.0, 1.0)
        pair.greys[1][:] = (1.0 - lost) * pair.greys[1] + lost * grey
        pair.hidden[1] |= lost > 0.0


def _defocus(rng: np.random.Generator, pair: _Pair) -> None:
    """Part of the target out of focus."""
    blurred = cv2.GaussianBlur(pair.greys[1], (0, 0), rng.uniform(0.6, 2.0))
    away = (_X - _somewhere(rng, 40.0)) / rng.uniform(15.0, 60.0, 2)
    share = 1.0 / (1.0 + np.exp(np.clip(6.0 * (np.hypot(away[..., 0], away[..., 1]) - 1.0), -60.0, 60.0)))
    pair.greys[1][:] = (1.0 - share) * pair.greys[1] + share * blurred


def _nothing(rng: np.random.Generator, pair: _Pair) -> None:
    """The crack is in the motion."""


def _jump(rng: np.random.Generator, largest: float, motion: Motion) -> Motion:
    normal, opening = _direction(rng), rng.uniform(0.0, largest)
    slip = rng.uniform(-largest, largest) * (rng.random() < 0.6)
    if rng.random() < 0.25:
        opening, slip = 0.0, rng.choice([-1.0, 1.0]) * opening
    jump = opening * normal + slip * np.array([-normal[1], normal[0]])
    return motion._replace(place=_somewhere(rng, 60.0), normal=normal, jump=jump)


KINDS: dict[str, Change] = {
    "good": _good,
    "glints": _glints,
    "shadow": _shadow,
    "occluder": _occluder,
    "flakes": _flakes,
    "defocus": _defocus,
    "crack": _nothing,
    "fine crack": _nothing,
}
"""What disturbs a scene of each kind."""


def scene(kind: str, seed: int) -> Scene:
    """A random scene of one of :data:`KINDS`."""
    rng = np.random.default_rng([sorted(KINDS).index(kind), seed])
    size = np.exp(rng.uniform(np.log(3.0), np.log(8.0)))
    subset_size = int(rng.choice([s for s in (21, 31, 41) if s > 3.8 * size]))
    pattern, motion = _pattern(rng, size), _motion(rng)
    if "crack" in kind:
        motion = _jump(rng, 4.0 if kind == "crack" else 0.5, motion)
    samples, contrast, ground = _samples(), rng.uniform(50.0, 180.0), rng.uniform(15.0, 60.0)
    material, gap = motion.material(samples)
    seen = [_seen(pattern, samples), _seen(pattern, material)]
    filled = rng.uniform(0.0, 1.0)
    seen[1] = np.where(gap, filled, seen[1])
    greys = [ground + contrast * light.mean(axis=-1) for light in seen]
    pair = _Pair(greys, [np.zeros((HEIGHT, WIDTH), dtype=bool) for _ in greys], motion, pattern)
    KINDS[kind](rng, pair)
    noise = 255.0 * rng.uniform(0.005, 0.03)
    levels = [np.rint(grey + rng.normal(0.0, noise, grey.shape)) for grey in pair.greys]
    taken = [grey.clip(0, 255).astype(np.uint8) for grey in levels]
    x, y = np.rint(motion.target(_X)).astype(int).clip(0, [WIDTH - 1, HEIGHT - 1]).transpose(2, 0, 1)
    return Scene(taken[0], taken[1], motion, pair.hidden[0] | pair.hidden[1][y, x], subset_size)
