"""The folder that the app was opened on: its pipeline files, and where their photographs and products are."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from dicflow.app.safety import inside
from dicflow.errors import ConfigurationError, DicflowError, InputError
from dicflow.io.configuration import parse, read
from dicflow.io.files import write_whole
from dicflow.pipeline import Pipeline

__all__ = ["USUAL", "Project", "is_blank", "open_project"]

USUAL = "pipeline.yaml"
"""Name of the pipeline file that the app makes, and opens first."""

_OWN = ".dicflow-app"
_MOST_LISTED = 200


class Project(NamedTuple):
    """What the app was opened on.

    folder : holds the pipeline files; without links
    data : where their relative paths start; None for the folder itself
    store : folder of the products; None for ``.dicflow`` beside the file
    chosen : name of the pipeline file that the app was opened on; "" for the folder
    """

    folder: Path
    data: Path | None = None
    store: Path | None = None
    chosen: str = ""

    @property
    def data_folder(self) -> Path:
        """Where relative paths of photographs and regions start."""
        return self.data or self.folder

    @property
    def own_folder(self) -> Path:
        """Where versions and pictures are kept; made when it is first used."""
        folder = self.folder / _OWN
        if not folder.is_dir():
            write_whole(folder / ".gitignore", b"*\n")
        return folder

    @property
    def roots(self) -> tuple[Path, ...]:
        """Folders in which the app reads and writes."""
        return (self.folder, *((self.data,) if self.data else ()))

    def path(self, name: str) -> Path:
        """A file by its name relative to the folder. Raises InputError if it lies outside the folders."""
        return inside(self.roots, self.folder / name)

    def data_path(self, name: str) -> Path:
        """A file that a pipeline names. Raises InputError if it lies outside."""
        return inside(self.roots, self.data_folder / name)

    def name_of(self, path: Path) -> str:
        """The name by which :meth:`path` finds a file: relative to the folder, or whole for one elsewhere."""
        return (path.relative_to(self.folder) if path.is_relative_to(self.folder) else path).as_posix()

    def pipeline(self, name: str) -> Pipeline:
        """A pipeline file, validated. Raises ConfigurationError as the command line does."""
        path = self.path(name)
        return _loaded(path, path.stat().st_mtime_ns if path.is_file() else 0, self.data, self.store)

    def candidate(self, name: str, text: str) -> Pipeline:
        """The pipeline that a file would be with another text; nothing is written."""
        path = self.path(name)
        store = self.store or path.parent / ".dicflow"
        candidate = Pipeline(path, parse(text, str(path)), self.data or path.parent, store)
        assert candidate.instances
        return candidate

    def pipelines(self) -> list[str]:
        """Names of the pipeline files in the folder."""
        return [path.name for path in self._yaml_files() if _is_meant(path)]

    def _yaml_files(self) -> Iterator[Path]:
        names = sorted(entry.name for entry in os.scandir(self.folder) if entry.is_file() and entry.name[0] != ".")
        found = [self.folder / name for name in names if name.lower().endswith((".yaml", ".yml"))]
        return iter(found[:_MOST_LISTED])


@lru_cache(maxsize=8)
def _loaded(path: Path, _changed: int, data: Path | None, store: Path | None) -> Pipeline:
    return Pipeline.load(path, data=data, store=store)


def _is_meant(path: Path) -> bool:
    """Whether a file is meant to be a pipeline, right or wrong: it has stages, or the usual name and any content."""
    if path.name == USUAL:
        return not is_blank(path)
    try:
        return "stages" in read(path).data
    except ConfigurationError as error:
        return "stages:" in _text(path) and "not valid YAML" in str(error)


def is_blank(path: Path) -> bool:
    """Whether a file holds nothing, or cannot be read."""
    return not _text(path).strip()


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")[:100_000]
    except OSError:
        return ""


def open_project(path: Path, data: Path | None = None, store: Path | None = None) -> Project:
    """The project of a folder or a pipeline file. Raises InputError or ConfigurationError for what is not there."""
    if data is not None and not data.is_dir():
        raise ConfigurationError(f"{data}: no such folder; --data names the folder that holds the photographs")
    folder, chosen = (path.parent, path.name) if path.is_file() else (path, "")
    if not folder.is_dir():
        raise InputError(str(path), "no such folder or file", "name the folder of the photographs, or a pipeline file")
    try:
        resolved = [one.resolve() if one is not None else None for one in (data, store)]
        return Project(folder.resolve(), resolved[0], resolved[1], chosen)
    except (OSError, RuntimeError) as error:
        raise DicflowError(f"{folder}: cannot be followed ({error}); name another folder") from error
