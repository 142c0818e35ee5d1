"""Writing files for the user: whole or not at all.

What a killed process has left behind is removed when something is written to the same folder.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from dicflow.engine.drafts import DRAFT, draft_name, is_abandoned
from dicflow.engine.whole_file import write_file
from dicflow.errors import ConfigurationError, InputError

__all__ = ["make_folder", "staged", "write_whole"]

_DRAFT = re.compile(rf"\.export-({DRAFT})|.*\.({DRAFT})\.part", re.DOTALL)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, or replace it, as a whole; its folder is made if it is missing.

    Raises InputError that names the file if it cannot be written; an existing file is then left untouched.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _clear_once(path.parent)
        write_file(path, content)
    except OSError as error:
        raise _unwritable(path, error) from error


def make_folder(folder: Path) -> None:
    """Make a folder in which files can be written. Raises InputError that names it if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".{draft_name()}.part"
        probe.touch()
        probe.unlink()
        _clear(folder)
    except OSError as error:
        raise _unwritable(folder, error) from error


@contextmanager
def staged(output: Path, force: bool = False) -> Iterator[Path]:
    """A folder whose files move into ``output`` together, once the block has ended without an error.

    If the block fails or is interrupted, or a file of that name exists and ``force`` is not set, ``output`` is left
    untouched.
    Raises ConfigurationError that names the existing file, InputError if ``output`` cannot be written.
    """
    made = [folder for folder in (output, *output.parents) if not folder.exists()]
    make_folder(output)
    folder = output / f".export-{draft_name()}"
    try:
        folder.mkdir()
        yield folder
        _move(sorted(folder.iterdir()), output, force)
        made = []
    except OSError as error:
        raise _unwritable(Path(error.filename or output), error) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        for empty in made:
            with suppress(OSError):
                empty.rmdir()


def _move(files: list[Path], output: Path, force: bool) -> None:
    for file in files:
        taken = output / file.name
        if taken.is_dir():
            raise InputError(
                f"{taken}: cannot be written (a folder has this name); name another file, or move the folder"
            )
        if taken.exists() and not force:
            remedy = "add --force to overwrite it, or name another folder with --output"
            raise ConfigurationError(f"{taken} exists; {remedy}")
    for file in files:
        os.replace(file, output / file.name)


def _clear(folder: Path) -> None:
    """Remove drafts that nobody will finish. Raises OSError."""
    for path in folder.iterdir():
        match = _DRAFT.fullmatch(path.name)
        if match is not None and is_abandoned(path, match[1] or match[2], grace_s=0.0):
            with suppress(OSError, RecursionError):  # no draft is deep
                shutil.rmtree(path) if path.is_dir() else path.unlink()


_clear_once = cache(_clear)


def _unwritable(path: Path, error: OSError) -> InputError:
    reason = (error.strerror or type(error).__name__).lower()
    if isinstance(error, FileExistsError | NotADirectoryError):
        reason = "a file stands where a folder should be"
    return InputError(f"{path}: cannot be written ({reason}); name another place, or free this one")
