"""Photographs for the page: tiles of several levels, and thumbnails, as JPEG files that are made once.

A photograph is shown as the stage ``images`` reads it, so that pixels on the page are the pixels that are measured.
"""

from __future__ import annotations

import hashlib
import io
import re
import threading
from pathlib import Path
from typing import Any

import numpy as np

from dicflow.app.kept import keep_newest
from dicflow.app.project import Project
from dicflow.core.photographs.grey import reduced, scale_for, to_8bit
from dicflow.engine.files import FilePart, stamp
from dicflow.engine.whole_file import write_file
from dicflow.errors import ConfigurationError, InputError
from dicflow.io.files import write_whole
from dicflow.io.images import read_photograph, turned_upright
from dicflow.kinds.images import Images
from dicflow.pipeline import Pipeline

__all__ = ["TILE", "picture_path", "shown", "steps_of", "thumbnail"]

TILE = 512
"""Side of a tile [px]."""
_QUALITY = 88
_THUMBNAIL_PIXELS = 60_000
_NAME = re.compile(r"[0-9a-f]{32}/(info\.json|[0-9]/[0-9]{1,3}_[0-9]{1,3}\.jpg)|thumbnails/[0-9a-f]{32}\.jpg")
_ONE = threading.Lock()
"""One photograph is decoded at a time, which bounds the memory."""
_MOST_PHOTOGRAPHS, _MOST_THUMBNAILS = 100, 4000
"""Photographs whose tiles are kept, about 5 MB for each of 12 megapixels, and thumbnails of 3 kB."""


def picture_path(project: Project, name: str) -> Path:
    """A kept picture by its name. Raises InputError for any other name."""
    if not _NAME.fullmatch(name):
        raise InputError(name[:80], "is no picture of the app", "reload the page")
    return project.own_folder / "pictures" / name


def steps_of(pipeline: Pipeline, stage: str) -> list[str]:
    """Names of the steps of a stage ``images``. Raises InputError if its files are no series."""
    return list(_files(pipeline, stage))


def shown(project: Project, pipeline: Pipeline, stage: str, step: str | None, side: str) -> dict[str, Any]:
    """The tiles of a photograph, made if they are missing.

    step : None for the first one
    Returns ``key``, under which the tiles are named key/level/column_row.jpg, ``width``, ``height``, ``levels`` and
    ``tile``; level k is reduced by 2**k. Raises InputError if the photograph cannot be read.
    """
    files = _files(pipeline, stage)
    step = next(iter(files)) if step is None else step
    if step not in files or side not in files[step]:
        raise ConfigurationError(f"{stage}: there is no {side} photograph of step '{step}'; choose another")
    file = files[step][side]
    place = project.path(str(file.path if isinstance(file, FilePart) else file))
    node = pipeline.graph.stages[stage].node
    key = _key([str(place), *stamp(place), str(file), getattr(node, "orientation", None)])
    folder = project.own_folder / "pictures" / key
    size = (_sizes.get(key) or _size(folder)) if (folder / "info.json").is_file() else None
    if size is None:
        with _ONE:
            product = node.run(left=file)
            size = _write_tiles(folder, to_8bit(Images.read(product).left))
    _sizes[key] = size
    keep_newest(folder, _MOST_PHOTOGRAPHS)
    return {"key": key, "width": size[0], "height": size[1], "levels": _levels(size), "tile": TILE, "step": step}


_sizes: dict[str, tuple[int, int]] = {}
"""Width and height by key."""


def thumbnail(project: Project, name: str) -> Path:
    """A small picture of a photograph, upright as its tag says, made if it is missing. Raises InputError."""
    path = project.path(name)
    target = project.own_folder / "pictures" / "thumbnails" / f"{_key([str(path), *stamp(path)])}.jpg"
    if not target.is_file():
        with _ONE:
            photograph = read_photograph(path)
        grey = to_8bit(photograph.grey)
        small = turned_upright(reduced(grey, scale_for(grey, _THUMBNAIL_PIXELS)), photograph.orientation)
        write_whole(target, _jpeg(small))
        keep_newest(target, _MOST_THUMBNAILS)
    return target


def _files(pipeline: Pipeline, stage: str) -> dict[str, dict[str, Path | FilePart]]:
    """Step → left and right → file, of a stage that starts a series."""
    found = pipeline.graph.files.get(stage)
    if not found:
        raise ConfigurationError(f"no stage '{stage}' with photographs; name one of {', '.join(pipeline.graph.files)}")
    return {step: dict(files) for step, files in found.items()}


def _write_tiles(folder: Path, image: np.ndarray) -> tuple[int, int]:
    """Write all tiles of all levels, then the size (width, height), which says that they are there."""
    height, width = image.shape
    for level in range(_levels((width, height))):
        (folder / str(level)).mkdir(parents=True, exist_ok=True)
        for row in range(0, image.shape[0], TILE):
            for column in range(0, image.shape[1], TILE):
                path = folder / str(level) / f"{column // TILE}_{row // TILE}.jpg"
                write_file(path, _jpeg(image[row : row + TILE, column : column + TILE]))
        image = reduced(image, 0.5)
    write_whole(folder / "info.json", f"{width} {height}".encode())
    return width, height


def _levels(size: tuple[int, int]) -> int:
    """Number of levels until one tile holds the whole photograph."""
    return max(int(np.ceil(np.log2(max(size) / TILE))), 0) + 1


def _size(folder: Path) -> tuple[int, int] | None:
    try:
        width, height = map(int, (folder / "info.json").read_text().split())
    except (OSError, ValueError):
        return None
    return width, height


def _jpeg(image: np.ndarray) -> bytes:
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(stream, "JPEG", quality=_QUALITY)
    return stream.getvalue()


def _key(parts: list[Any]) -> str:
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]
