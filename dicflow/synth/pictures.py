"""Photographs of boards, and photographs as files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

import cv2
import numpy as np

from dicflow.core.arrays import Array, Bytes
from dicflow.core.cameras.camera import Rig
from dicflow.core.synthetic.checkerboard import Checkerboard
from dicflow.core.synthetic.deformation import Deformation
from dicflow.core.synthetic.render import GreyLevels, add_noise_and_round, render_board
from dicflow.core.synthetic.stand import in_right_frame

__all__ = ["LOOKS", "SIDES", "Progress", "Taken", "outline_text", "take_board", "write_photographs"]

Progress = Callable[[int, int, str], None]
"""Called after each photograph with the number done, their total, and the name."""
Taken = Callable[[], Bytes]
"""Takes a photograph."""

SIDES = ("left", "right")
LOOKS = (GreyLevels(), GreyLevels(gain=0.96, light=(0.07, -0.09), phase=1.7))
"""Grey levels of both cameras."""
_BOARD_PAPER, _BOARD_INK = 205.0, 34.0
_PNG = (cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY)  # noise repeats nothing worth searching for


def take_board(rig: Rig, pose: Deformation, board: Checkerboard, side: int, noise: float, seed: Sequence[int]) -> Bytes:
    """Photograph of a board: (height, width).

    pose : in the left camera's frame
    side : 0 — left, 1 — right camera
    """
    camera, look = (rig.left, rig.right)[side], LOOKS[side]._replace(paper=_BOARD_PAPER, ink=_BOARD_INK)
    seen = in_right_frame(rig, pose) if side else pose
    return add_noise_and_round(render_board(camera, seen, board, look), noise, seed)


def write_photographs(
    folder: Path, pictures: Mapping[str, Taken], workers: int = 1, on_progress: Progress | None = None
) -> None:
    """Write PNG files, and remove photographs that an earlier time left beside them.

    pictures : path inside the folder → takes it
    workers : photographs taken at once, in threads
    """
    _clear(folder, pictures)
    with ThreadPoolExecutor(max_workers=workers) as pool:
        running = {pool.submit(_write, folder / name, take): name for name, take in pictures.items()}
        for done, future in enumerate(as_completed(running), start=1):
            future.result()
            if on_progress is not None:
                on_progress(done, len(pictures), running[future])


def outline_text(outline: Array) -> str:
    """GeoJSON of the speckled region. outline : (n, 2), raw pixels of a photograph"""
    ring = np.round(outline, 3).tolist()
    feature = {
        "type": "Feature",
        "properties": {"frame": "photograph", "name": "speckled region"},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    return json.dumps({"type": "FeatureCollection", "features": [feature]}) + "\n"


def _write(path: Path, take: Taken) -> None:
    _, encoded = cv2.imencode(".png", take(), _PNG)
    path.write_bytes(encoded.tobytes())


def _clear(folder: Path, pictures: Mapping[str, Taken]) -> None:
    """Make the folders, and remove the photographs in them that are not written again."""
    kept = {folder / name for name in pictures}
    for place in sorted({path.parent for path in kept}):
        place.mkdir(parents=True, exist_ok=True)
        for path in [*place.glob("step_*.png"), *place.glob("board_*.png")]:
            if path not in kept:
                path.unlink()
