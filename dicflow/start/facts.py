"""What the files of photographs say of themselves: when they were taken, and by which camera."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import cache
from pathlib import Path, PurePosixPath

from dicflow.io.images import camera_model, time_taken
from dicflow.start.sorting import copied_from

__all__ = ["Facts"]


class Facts:
    """Facts of the photographs in a folder, each read once, when it is asked for.

    camera : path → make and model of the camera; empty if unknown
    taken : path → when the photograph was taken [s]; None if unknown
    """

    def __init__(self, folder: Path) -> None:
        self.camera: Callable[[PurePosixPath], str] = cache(lambda path: camera_model(folder / path))
        self.taken: Callable[[PurePosixPath], float | None] = cache(lambda path: time_taken(folder / path))

    def label(self, paths: Collection[PurePosixPath]) -> Callable[[PurePosixPath], str]:
        """What tells the cameras of photographs apart, beside their names.

        A copy that differs from its original was taken by another camera, also where the file does not say so.
        """
        return lambda path: self.camera(path) or ("another camera" if copied_from(path, paths) else "")
