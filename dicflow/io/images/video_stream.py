"""Frames of a video one after another, each decoded once as long as they are asked for in order."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import OrderedDict
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from dicflow.engine.files import Stamp, stamp
from dicflow.errors import InputError
from dicflow.io.images.libraries import opencv
from dicflow.io.images.quiet import quiet
from dicflow.io.images.video import SAME_TIME_S, video_of
from dicflow.io.images.video_capture import grabbed, start, time_of

__all__ = ["read_frame"]

_RECENT = 4
"""Frames that a stream remembers, for tasks that come in another order than the frames."""
_WORTH_A_JUMP = 16
"""Frames that are decoded rather than jumped over: the decoder goes back that far when it looks for one."""


def read_frame(path: Path, number: int) -> np.ndarray:
    """Grey levels (row, col) uint8 of a frame as the sensor lies: luma (ITU-R BT.601).

    number : from 1
    Raises InputError that names the file and the frame.
    """
    return _stream(path, stamp(path)).frame(number)


@lru_cache(maxsize=4)
def _stream(path: Path, unchanged: Stamp) -> _Stream:
    return _Stream(path)


class _Stream:
    """A video that is open at one place. Threads may share it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._video = video_of(path)
        self._capture: Any = None
        self._place = 0
        self._recent: OrderedDict[int, np.ndarray] = OrderedDict()
        self._lock = Lock()

    def frame(self, number: int) -> np.ndarray:
        with self._lock:
            if number not in self._recent:
                self._go_to(number)
            return self._recent[number].copy()

    def _go_to(self, number: int) -> None:
        if not 1 <= number <= len(self._video.times):
            raise InputError(f"{self._path}#{number}: the video has {len(self._video.times)} frames")
        with quiet():
            if self._capture is None or number <= self._place or self._key_before(number) > self._place + _WORTH_A_JUMP:
                self._jump(number)
            while self._place < number:
                self._advance(number)

    def _key_before(self, number: int) -> int:
        """The last frame up to this one that decodes without others."""
        keys = self._video.keys
        return keys[max(bisect_right(keys, number) - 1, 0)]

    def _jump(self, number: int) -> None:
        """Go to a frame before this one, as near as the decoder can: it may miss the frame that it looks for."""
        times = self._video.times
        for earlier in (0.0, 1.0, 4.0, 16.0) if number > 1 else ():
            self._capture = self._capture or start(self._path)
            self._capture.set(opencv().CAP_PROP_POS_MSEC, 1000.0 * max(times[number - 1] - earlier, 0.0))
            if self._capture.grab() and (place := self._known_place()) <= number:
                self._place = place
                self._remember(number)
                return
        self._capture, self._place = start(self._path), 0

    def _known_place(self) -> int:
        """Number of the frame that was grabbed."""
        return bisect_left(self._video.times, time_of(self._capture) - SAME_TIME_S) + 1

    def _advance(self, number: int) -> None:
        if not grabbed(self._capture):
            raise InputError(
                f"{self._path}#{self._place + 1}: the video cannot be decoded from here on; copy it again from the "
                "camera, or end before with select: {to: …}"
            )
        if (place := self._known_place()) <= self._place:
            return  # a frame that an edit has left out
        self._place = place
        self._remember(number)
        if place > number:
            raise _undecodable(self._path, number)

    def _remember(self, number: int) -> None:
        """Keep the frame that was grabbed, if it is near the one that is asked for."""
        if self._place <= number - _RECENT:
            return
        found, image = self._capture.retrieve()
        if not found:
            raise _undecodable(self._path, self._place)
        grey = image if image.ndim == 2 else opencv().cvtColor(image, opencv().COLOR_BGR2GRAY)
        self._recent[self._place] = grey
        while len(self._recent) > _RECENT:
            self._recent.popitem(last=False)


def _undecodable(path: Path, number: int) -> InputError:
    remedy = "copy the video again from the camera, or leave its step out with select: {without: [name of the step]}"
    return InputError(f"{path}#{number}: the frame cannot be decoded; {remedy}")
