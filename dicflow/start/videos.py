"""Videos in a folder: where boards are looked for in them, and which of their frames are measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dicflow.engine.files import FilePart
from dicflow.errors import InputError
from dicflow.io.images import is_video, joined_clocks, video_of

__all__ = ["SHARPEST", "UNKNOWN_OFFSET", "frames_to_see", "video_parameters"]

SHARPEST: Mapping[str, int] = {"sharpest": 30}
"""Which frames of a board's video are used."""
UNKNOWN_OFFSET = 0.0
"""Offset of clocks that nothing joins."""
_MOST_STEPS = 300
"""Frames of a test that are measured at first."""
_LOOKS = (0.25, 0.5, 0.75)
"""Where in a video a board is looked for, as shares of its frames."""


def frames_to_see(path: Path) -> list[Path | FilePart]:
    """A photograph itself, or a few frames of a video. Raises InputError for a video that cannot be read."""
    if not is_video(path):
        return [path]
    last = len(video_of(path).times)
    return [FilePart(path, max(round(share * last), 1)) for share in _LOOKS]


def video_parameters(files: Sequence[Path], select: Mapping[str, int] | None) -> dict[str, Any]:
    """Parameters of the stage of the photographs for the videos of one camera or two; none for photographs.

    select : which frames are used; None for a few hundred at most
    Raises InputError for a video that cannot be read.
    """
    if not all(map(is_video, files)):
        return {}
    every = -(-min(len(video_of(file).times) for file in files) // _MOST_STEPS)
    chosen = {"select": dict(select or {"every": every})}
    return chosen if len(files) == 1 else {"offset": _offset(*files), **chosen}


def _offset(left: Path, right: Path) -> float | str:
    try:
        joined_clocks(left, right)
    except InputError:
        return UNKNOWN_OFFSET
    return "auto"
