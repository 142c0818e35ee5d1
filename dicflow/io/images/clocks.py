"""The clocks of two videos, joined by what both cameras saw."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from dicflow.engine.files import FilePart, Stamp, stamp
from dicflow.errors import InputError
from dicflow.io.images.surveys import survey_of
from dicflow.io.images.video import Video, video_of

if TYPE_CHECKING:
    from dicflow.core.motion.clocks import Joined, Signal
    from dicflow.core.motion.survey import Survey

__all__ = ["joined_clocks", "joined_sentence"]

_MOST_FRAMES = 0.5
"""Uncertainty above which an offset is not used, as a share of the longer interval between two frames."""


def joined_clocks(left: Path, right: Path) -> Joined:
    """When the first frame of the right video was taken, since the first of the left one.

    Found from the motion of the picture, or from a change of the light that both saw, whichever says it more exactly.
    Raises InputError where neither does, or a video cannot be read.
    """
    return _joined(left, right, (stamp(left), stamp(right)))


@lru_cache(maxsize=8)
def _joined(left: Path, right: Path, unchanged: tuple[Stamp, Stamp]) -> Joined:
    """The same, found once. unchanged : the stamps of the files"""
    from dicflow.core.motion.clocks import join_clocks

    videos = video_of(left), video_of(right)
    seen = [
        survey_of([FilePart(path, k + 1) for k in range(len(video.times))])
        for path, video in zip((left, right), videos, strict=True)
    ]
    pairs = zip(*(_signals(video, one) for video, one in zip(videos, seen, strict=True)), strict=True)
    joined = [one for one in (join_clocks(*pair) for pair in pairs) if one is not None]
    best = min((one for one in joined if one.is_unique), key=lambda one: one.u, default=None)
    if best is None or best.u > _MOST_FRAMES * max(video.interval for video in videos):
        raise InputError(
            f"{left.name} and {right.name}: the clocks cannot be joined, since {_why_not(best, joined)}; give offset, "
            "the time of the right video's first frame since the left one's [s] (0 with a common trigger), or record a "
            "flash or a jerk at the start"
        )
    return best


def _why_not(best: Joined | None, joined: list[Joined]) -> str:
    """The reason for which an offset is not used."""
    if best is not None:
        return (
            f"what both saw determines the offset ({best.offset:.3f} s) to {best.u:.2g} s only, more than half a frame"
        )
    if joined:
        likeliest = min(joined, key=lambda one: one.u)
        return f"another offset explains what both saw nearly as well as {likeliest.offset:.3f} s"
    return "no motion and no change of the light is in both"


def joined_sentence(left: Path, right: Path, joined: Joined) -> str:
    """What was found, for people who want to check it."""
    order = "after" if joined.offset >= 0.0 else "before"
    return (
        f"{right.name} begins {abs(joined.offset):.3f} s {order} {left.name} by "
        f"what both cameras saw (standard uncertainty {max(1000.0 * joined.u, 0.1):.1f} ms); write "
        f"offset: {joined.offset:.4f} to keep this, or correct it"
    )


def _signals(video: Video, seen: Survey) -> tuple[Signal, Signal]:
    """Motion of the picture and mean grey level over time."""
    import numpy as np

    from dicflow.core.motion.clocks import Signal, principal_motions

    times = np.array(video.times)
    return Signal(times, principal_motions(seen.cells)), Signal(times, seen.level[:, None])
