"""Photographs of one camera with exactly known strain, and the pipeline that measures them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from scipy.special import erf

from dicflow.core.synthetic.motion import Motion, render_pattern, speckle_pattern
from dicflow.core.synthetic.render import add_noise_and_round

SIDE, MARGIN = 240, 20
PIPELINE = f"""\
# one camera
stages:
  photos: {{stage: images, left: "*.png"}}
  region: {{stage: region, images: photos, rectangle: [{MARGIN}, {MARGIN}, {SIDE - MARGIN}, {SIDE - MARGIN}]}}
  correlation: {{stage: correlate, images: photos, subset_size: 31, step_size: 7}}  # as init writes it
  total: {{stage: deformation, points: correlation, window: 50 px}}
"""

Strains = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""εxx and εyy at places (..., 2) of the first photograph."""


def uniform(strain: float) -> tuple[Motion, Strains]:
    """Tension along y, with contraction across."""
    stretch = np.diag([1.0 - 0.4 * strain, 1.0 + strain])

    def motion(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return points @ stretch, np.broadcast_to(stretch, (*points.shape, 2))

    return motion, lambda places: (np.full(places.shape[:-1], -0.4 * strain), np.full(places.shape[:-1], strain))


def band(strain: float, width: float) -> tuple[Motion, Strains]:
    """A band across the middle: εyy = strain · exp(−(y − m)²/(2 width²)). width [px]"""

    def here(points: np.ndarray) -> np.ndarray:
        return strain * np.exp(-0.5 * ((points[..., 1] - SIDE / 2) / width) ** 2)

    def motion(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        moved = points.copy()
        moved[..., 1] += strain * width * np.sqrt(np.pi / 2) * erf((points[..., 1] - SIDE / 2) / (np.sqrt(2) * width))
        gradient = np.zeros((*points.shape, 2)) + np.eye(2)
        gradient[..., 1, 1] += here(points)
        return moved, gradient

    return motion, lambda places: (np.zeros(places.shape[:-1]), here(places))


def photographed(folder: Path, motion: Motion, noise: float, still: bool = True, seed: int = 0) -> Path:
    """Photographs of the unloaded pattern, once or twice, and of the moved one; returns the pipeline's file."""
    pattern = speckle_pattern((SIDE, SIDE), (3.0, 6.0), 1.5, 0.5, seed=seed)
    unloaded, loaded = (render_pattern(pattern, (SIDE, SIDE), one, order=2) for one in (None, motion))
    images = [unloaded, unloaded, loaded] if still else [unloaded, loaded]
    folder.mkdir(parents=True, exist_ok=True)
    for number, image in enumerate(images):
        cv2.imwrite(str(folder / f"step_{number}.png"), add_noise_and_round(image, noise, [seed, number]))
    path = folder / "pipeline.yaml"
    path.write_text(PIPELINE)
    return path
