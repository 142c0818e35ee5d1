"""Opening videos with OpenCV's own decoder."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dicflow.errors import InputError
from dicflow.io.images.libraries import opencv
from dicflow.io.images.quiet import quiet
from dicflow.io.text import printable

__all__ = ["complaint", "grabbed", "opened", "start", "time_of"]

_PACKETS = -1
"""Format of frames that are not decoded."""
_SPEAKER = re.compile(r"^\[[^\]]*\]\s*")
_MOST_LETTERS = 200
_MOST_DAMAGED = 30
"""Frames in a row that cannot be decoded, after which the video counts as ended."""


@contextmanager
def opened(path: Path, packets: bool = False, threads: int = 1) -> Iterator[Any]:
    """A capture of a video, as the sensor lies, that is released in the end.

    packets : frames are found, in the order of the file, but not decoded
    Raises InputError, without the file's name, if it cannot be opened.
    """
    capture = start(path, packets, threads)
    try:
        yield capture
    finally:
        capture.release()


def start(path: Path, packets: bool = False, threads: int = 1) -> Any:
    """The capture of :func:`opened`, which the caller releases."""
    cv2 = opencv()
    options = [cv2.CAP_PROP_FORMAT, _PACKETS] if packets else [cv2.CAP_PROP_N_THREADS, threads]
    with quiet() as heard:
        capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, options)
        said = complaint(heard())
    if not capture.isOpened():
        raise InputError(
            f"the video cannot be opened{said and f' ({said})'}; if its recording was interrupted, repair it with the "
            "camera's program, else save it as MP4, MOV, AVI or MKV with H.264"
        )
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    return capture


def grabbed(capture: Any) -> bool:
    """Take the next frame that can be decoded; returns whether there is one."""
    return any(capture.grab() for _ in range(_MOST_DAMAGED))


def time_of(capture: Any) -> float:
    """Time of the frame taken last from a capture, since the first of the video [s]."""
    return float(capture.get(opencv().CAP_PROP_POS_MSEC)) / 1000.0


def complaint(heard: str) -> str:
    """The first line that the decoder wrote about damage, without its name; empty if it wrote nothing."""
    lines = (_SPEAKER.sub("", line.strip()) for line in heard.splitlines())
    return next((printable(line, _MOST_LETTERS) for line in lines if line), "")
