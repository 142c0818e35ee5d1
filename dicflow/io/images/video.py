"""Which frames a video has, and when: read from its packets, without decoding them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from dicflow.engine.files import Stamp, stamp
from dicflow.errors import InputError
from dicflow.io.images.libraries import opencv
from dicflow.io.images.quiet import quiet
from dicflow.io.images.video_capture import complaint, grabbed, opened, time_of

__all__ = ["SAME_TIME_S", "Video", "video_of"]

SAME_TIME_S = 0.0005
"""Times of one frame, read in two ways, differ by less."""
_MOST_FRAMES = 1_000_000
_ORIENTATIONS = {90: 6, 180: 3, 270: 8}
"""Angle by which a player turns the frames clockwise → tag of a photograph that is turned so."""
_STEADY = 0.1
"""Intervals of a steady video differ from their mean by less than this share: containers round times."""
_ROUNDING_S = 0.001


class Video(NamedTuple):
    """The frames of a video.

    width, height : as the sensor lies [px]
    orientation : as of a photograph, 1 … 8
    times : of all frames since the first [s], rising
    keys : numbers of the frames that decode without others, from 1
    complaint : what the decoder said of damage; empty if nothing
    """

    width: int
    height: int
    orientation: int
    times: tuple[float, ...]
    keys: tuple[int, ...]
    complaint: str = ""

    @property
    def interval(self) -> float:
        """Mean time between two frames [s]; 0 for a single one."""
        return (self.times[-1] - self.times[0]) / max(len(self.times) - 1, 1)

    @property
    def is_steady(self) -> bool:
        """Whether all frames are equally far apart in time."""
        allowed = _STEADY * self.interval + _ROUNDING_S
        gaps = (b - a for a, b in pairwise(self.times))
        return all(abs(gap - self.interval) <= allowed for gap in gaps)


def video_of(path: Path) -> Video:
    """What a video holds. Raises InputError that names the file if it cannot be opened or has no frames."""
    try:
        return _video(path, stamp(path))
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(str(path)) else f"{path}: {text}") from error


@lru_cache(maxsize=16)
def _video(path: Path, unchanged: Stamp) -> Video:
    """The same, looked up once. unchanged : the stamp of the file"""
    with quiet() as heard:
        with opened(path, packets=True) as capture:
            found = sorted((time_of(capture), _is_key(capture)) for _ in _grabbed(capture))
        if not _ends_at(path, [time for time, _ in found]):
            found = _decoded(path)  # an edit leaves frames out, or they cannot be decoded
        said = complaint(heard())
    if not found:
        why = said and f" ({said})"
        raise InputError(f"no frame of the video can be decoded{why}; copy it again from the camera, or leave it out")
    times = tuple(time for time, _ in found)
    keys = tuple(k for k, (_, is_key) in enumerate(found, start=1) if is_key)
    return Video(*_size(path), times, keys, said)


def _grabbed(capture: Any) -> Iterator[None]:
    """One turn for every frame or packet. Raises InputError for more than a test can have."""
    for _ in range(_MOST_FRAMES):
        if not grabbed(capture):
            return
        yield
    raise InputError(f"more than {_MOST_FRAMES} frames; cut the video to the test")


def _is_key(capture: Any) -> bool:
    return bool(capture.get(opencv().CAP_PROP_LRF_HAS_KEY_FRAME))


def _ends_at(path: Path, times: list[float]) -> bool:
    """Whether the decoder finds the last of these frames where it should be."""
    if not times or min(b - a for a, b in zip([-1.0, *times], times, strict=False)) <= 0.0:
        return False
    with opened(path) as capture:
        first = capture.grab() and abs(time_of(capture) - times[0]) < SAME_TIME_S
        capture.set(opencv().CAP_PROP_POS_MSEC, 1000.0 * times[-1])
        last = 0.0
        while grabbed(capture):
            last = time_of(capture)
        return bool(first) and abs(last - times[-1]) < SAME_TIME_S


def _decoded(path: Path) -> list[tuple[float, bool]]:
    """Time of every frame that can be decoded, none of them known to decode alone but the first."""
    found: list[tuple[float, bool]] = []
    with opened(path, threads=0) as capture:
        for _ in _grabbed(capture):
            time = time_of(capture)
            if not found or time > found[-1][0]:
                found.append((time, not found))
    return found


def _size(path: Path) -> tuple[int, int, int]:
    """Width and height as the sensor lies [px], and orientation."""
    cv2 = opencv()
    with opened(path) as capture:
        width, height = (int(capture.get(name)) for name in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        turned = int(capture.get(cv2.CAP_PROP_ORIENTATION_META))
    return width, height, _ORIENTATIONS.get(turned % 360, 1)
