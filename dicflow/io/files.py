"""Writing files for the user: whole or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dicflow.engine.whole_file import write_file
from dicflow.errors import ConfigurationError, InputError

__all__ = ["make_folder", "staged", "write_whole"]


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, or replace it, as a whole; its folder is made where there is none.

    Raises InputError that names the file where it cannot be written; what stood there then still does.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, content)
    except OSError as error:
        raise _unwritable(path, error) from error


def make_folder(folder: Path) -> None:
    """Make a folder in which files can be written. Raises InputError that names it where that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".{os.getpid()}.part"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise _unwritable(folder, error) from error


@contextmanager
def staged(output: Path, force: bool = False) -> Iterator[Path]:
    """A folder whose files move into ``output`` together, once the block has ended well.

    Where the block fails or is interrupted, or one of the names is taken and ``force`` is not set, nothing is left
    behind and what stood in ``output`` still does.
    Raises ConfigurationError that names the file that is there, InputError where ``output`` cannot be written.
    """
    made = [folder for folder in (output, *output.parents) if not folder.exists()]
    make_folder(output)
    folder = output / f".export-{os.getpid()}"
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
                f"{taken}: cannot be written (a folder stands there); name another place, or free this one"
            )
        if taken.exists() and not force:
            raise ConfigurationError(f"{taken} exists; add --force to overwrite it, or name another folder")
    for file in files:
        os.replace(file, output / file.name)


def _unwritable(path: Path, error: OSError) -> InputError:
    reason = (error.strerror or type(error).__name__).lower()
    if isinstance(error, FileExistsError | NotADirectoryError):
        reason = "a file stands where a folder should be"
    return InputError(f"{path}: cannot be written ({reason}); name another place, or free this one")
