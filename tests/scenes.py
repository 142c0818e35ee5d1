"""Exact stereo images of textured surfaces, for the tests of matching and reconstruction."""

from __future__ import annotations

import numpy as np

from dicflow.core.cameras.camera import Camera, Rig, to_right, undistort

WAVES = 60


def texture(x: np.ndarray, y: np.ndarray, shortest: float = 5.0, seed: int = 11) -> np.ndarray:
    """A pattern of waves in all directions, 1 to 3 times the shortest wavelength, about 0 … 255."""
    generator = np.random.default_rng(seed)
    length = shortest * generator.uniform(1.0, 3.0, WAVES)
    angle, phase = generator.uniform(0.0, 2.0 * np.pi, (2, WAVES))
    total = np.zeros(np.broadcast(x, y).shape)
    for wave, turn, start in zip(2.0 * np.pi / length, angle, phase, strict=True):
        total += np.cos(wave * (np.cos(turn) * x + np.sin(turn) * y) + start)
    return 127.0 + 45.0 * total / np.sqrt(WAVES / 2.0)


def grey(values: np.ndarray, noise: float = 0.0, seed: int = 0, dtype: type = np.uint8) -> np.ndarray:
    """Grey levels with normal noise [grey levels of 255]; 16 bit ones are 200 times as large."""
    noisy = values + np.random.default_rng(seed).normal(0.0, noise, values.shape) if noise else values
    scale, top = (1, 255) if dtype is np.uint8 else (200, 65535)
    return np.clip(np.round(noisy * scale), 0, top).astype(dtype)


def rectified_plane(
    shape: tuple[int, int], offset: float, slope_x: float, slope_y: float, noise: float = 0.0, dtype: type = np.uint8
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Left and right image and the disparity offset + slope_x · x + slope_y · y at the left pixels."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(float)
    partner = (x + offset + slope_y * y) / (1.0 - slope_x)
    left, right = grey(texture(x, y), noise, 1, dtype), grey(texture(partner, y), noise, 2, dtype)
    return left, right, offset + slope_x * x + slope_y * y


def photographs_of_plane(
    rig: Rig, normal: np.ndarray, distance_mm: float, shortest_mm: float = 1.2
) -> list[np.ndarray]:
    """Both photographs of the textured plane normal · X0 = distance in the left camera's frame."""
    right_normal = rig.rotation @ normal
    right_distance = distance_mm + right_normal @ rig.translation
    left = _plane_points(rig.left, normal, distance_mm)
    right = (_plane_points(rig.right, right_normal, right_distance) - rig.translation) @ rig.rotation
    assert np.allclose(to_right(rig, left[:1, :1]) @ right_normal, right_distance)
    return [
        grey(texture(points[..., 0], points[..., 1], shortest_mm), 0.5, side)
        for side, points in enumerate((left, right))
    ]


def _plane_points(camera: Camera, normal: np.ndarray, distance: float) -> np.ndarray:
    """Where the rays of all pixels meet a plane, (rows, cols, 3) in the camera's frame [mm]."""
    width, height = camera.size
    places = undistort(camera, np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1))
    rays = np.concatenate([places, np.ones((height, width, 1))], axis=-1)
    return rays * (distance / (rays @ normal))[..., None]
