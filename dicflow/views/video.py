"""Pictures one after another as a movie that any browser plays."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dicflow.errors import ConfigurationError, DicflowError

__all__ = ["movie"]

_CODECS = {".mp4": "vp09", ".webm": "VP90"}
"""Names of VP9 in each container; without patents, so OpenCV's wheels write it and browsers play it."""


def movie(frames: Iterable[NDArray[np.uint8]], path: Path, seconds: float = 0.5) -> None:
    """Write a movie in the format of the path's suffix.

    frames : (row, col, 3) RGB each, all of one size; one is held at a time
    path : .mp4 or .webm, which hold VP9, with a row or column of white more where the size is odd
    seconds : for which each frame is shown
    Raises ConfigurationError for another suffix and ValueError for no frames or frames that differ in size.
    """
    if path.suffix not in _CODECS:
        raise ConfigurationError(f"{path.name}: a film is {' or '.join(_CODECS)}, not '{path.suffix}'")
    _write_vp9(_of_one_size(frames), path, seconds)


def _of_one_size(frames: Iterable[NDArray[np.uint8]]) -> Iterator[NDArray[np.uint8]]:
    shape = None
    for frame in frames:
        if shape not in (None, frame.shape):
            raise ValueError(f"frames of a film have one size: {shape} and {frame.shape} found")
        shape = frame.shape
        yield frame
    if shape is None:
        raise ValueError("a film needs at least one frame")


def _write_vp9(frames: Iterator[NDArray[np.uint8]], path: Path, seconds: float) -> None:
    first = next(frames)
    height, width = first.shape[:2]
    odd = (0, height % 2, 0, width % 2)
    with _quiet():
        code = cv2.VideoWriter.fourcc(*_CODECS[path.suffix])
        writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, 1.0 / seconds, (width + odd[3], height + odd[1]))
    if not writer.isOpened():
        raise DicflowError(
            f"{path}: this OpenCV writes no VP9; export a .gif, or install opencv-python-headless by pip"
        )
    try:
        for frame in chain([first], frames):
            even = cv2.copyMakeBorder(frame, *odd, cv2.BORDER_CONSTANT, value=(255, 255, 255))
            writer.write(cv2.cvtColor(even, cv2.COLOR_RGB2BGR))
    finally:
        writer.release()


@contextmanager
def _quiet() -> Iterator[None]:
    """Hide FFmpeg's messages about the codec's name on standard error."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
