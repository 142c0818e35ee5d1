"""A speckle pattern without any interpolation: dark Gaussian blobs at material points, deformed exactly."""

from __future__ import annotations

import numpy as np

AREA_PER_BLOB = 45.0


class Pattern:
    """Blobs in a box (x0, y0, x1, y1) [px] on a plain grey ground."""

    def __init__(self, box, seed=0):
        rng = np.random.default_rng(seed)
        count = int((box[2] - box[0]) * (box[3] - box[1]) / AREA_PER_BLOB)
        self.places = rng.uniform(box[:2], box[2:], (count, 2))
        self.radii = rng.uniform(1.0, 2.0, count)
        self.depths = rng.uniform(0.6, 1.3, count)

    def photograph(self, shape, mapping=None, seed=None, noise=1.5, white=210.0):
        """Grey levels (rows, cols) uint8 with every blob carried by ``mapping`` and stretched by its gradient."""
        mapping = mapping or (lambda points: points)
        carried = mapping(self.places)
        gradients = np.stack(
            [(mapping(self.places + d) - mapping(self.places - d)) / 2e-3 for d in 1e-3 * np.eye(2)], axis=-1
        )
        ink = np.zeros(shape)
        for place, gradient, radius, depth in zip(carried, gradients, self.radii, self.depths, strict=True):
            reach = int(6 * radius * np.abs(gradient).max())
            x0, y0 = np.maximum(0, place.astype(int) - reach)
            x1, y1 = np.minimum(shape[::-1], place.astype(int) + reach + 2)
            if x0 < x1 and y0 < y1:
                offsets = np.stack(np.meshgrid(np.arange(x0, x1), np.arange(y0, y1)), axis=-1) - place
                material = offsets @ np.linalg.inv(gradient).T / radius
                ink[y0:y1, x0:x1] += depth * np.exp(-0.5 * (material**2).sum(axis=-1))
        grey = 40 + (white - 40) * np.exp(-ink)
        if seed is not None:
            grey = grey + np.random.default_rng(seed).normal(0, noise, shape)
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def stretched(stretch, fixed, bend=0.0):
    """Stretch along y with the lateral contraction of rubber, and a stretch that varies along y by ``bend`` per px."""

    def mapping(points):
        x, y = (points - fixed).T
        moved = np.stack([x / np.sqrt(stretch), stretch * y + 0.5 * bend * y**2], axis=-1)
        return moved + fixed

    return mapping
