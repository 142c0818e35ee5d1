"""Which frames of two videos belong together, once their clocks are joined."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from dicflow.errors import InputError
from dicflow.io.images.video import Video, video_of

__all__ = ["FramePair", "lag_sentence", "length_sentence", "pair_frames"]

_MS = 1000.0
_EXACT_S = 0.0005
"""Frames that are nearer in time than this count as taken at one moment."""


class FramePair(NamedTuple):
    """Frames of one moment.

    left, right : their numbers, from 1
    lag : by how much the right one was taken later [s]
    """

    left: int
    right: int
    lag: float


def pair_frames(left: Path, right: Path, offset: float) -> list[FramePair]:
    """The frames of two videos that are nearest in time to one another, each in one pair at most.

    offset : when the first frame of the right video was taken, since the first of the left one [s]
    Raises InputError if the videos share no time, or cannot be read.
    """
    one, other = video_of(left), video_of(right)
    later = [time + offset for time in other.times]
    there = [_nearest(later, time) for time in one.times]
    back = [_nearest(one.times, time) for time in later]
    mutual = [(k, place) for k, place in enumerate(there) if back[place] == k]
    pairs = [FramePair(k + 1, place + 1, later[place] - one.times[k]) for k, place in mutual]
    pairs = [pair for pair in pairs if abs(pair.lag) <= max(one.interval, other.interval)]
    if not pairs:
        raise InputError(
            f"{left} and {right}: the videos share no time, since the right one begins {offset:.3f} s after the left "
            f"one, which is {one.times[-1]:.1f} s long; correct offset, or set it to auto"
        )
    return pairs


def lag_sentence(left: Path, right: Path, pairs: Sequence[FramePair]) -> str:
    """What remains between the moments of paired frames; empty if nothing does."""
    longest = max(abs(pair.lag) for pair in pairs)
    if longest < _EXACT_S:
        return ""
    rms = (sum(pair.lag**2 for pair in pairs) / len(pairs)) ** 0.5
    return (
        f"{left.name} and {right.name}: the frames of a pair are up to {_MS * longest:.1f} ms apart "
        f"(root mean square {_MS * rms:.1f} ms): the right camera sees a point that moves at v mm/s up to "
        f"{longest:.4f}·v mm away from its place; load slower, or record with a trigger, or more frames per second"
    )


def length_sentence(left: Path, right: Path, pairs: Sequence[FramePair]) -> str:
    """Which frames have no partner; empty if all have one."""
    one, other = video_of(left), video_of(right)
    alone = len(one.times) - len(pairs), len(other.times) - len(pairs)
    if not any(alone):
        return ""
    return (
        f"{_described(left, one)} and {_described(right, other)} give {len(pairs)} pairs: {alone[0]} left and "
        f"{alone[1]} right frames have no partner and are left out; let both "
        "cameras record the whole test at one rate to use more"
    )


def _described(path: Path, video: Video) -> str:
    rate = f", {1.0 / video.interval:.4g} frames/s" if video.interval else ""
    return f"{path.name} ({video.times[-1]:.2f} s{rate})"


def _nearest(times: Sequence[float], time: float) -> int:
    """Index of the nearest of rising times."""
    place = bisect_left(times, time)
    return min(
        (k for k in (place - 1, place) if 0 <= k < len(times)),
        key=lambda k: abs(times[k] - time),
    )
