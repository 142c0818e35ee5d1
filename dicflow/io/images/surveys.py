"""A look at all photographs of a series, kept on this account: decoding a long video takes a while."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from dicflow.engine.files import FilePart, stamp
from dicflow.engine.hashing import digest_json
from dicflow.engine.kernel_cache import account_folder
from dicflow.engine.whole_file import write_file
from dicflow.errors import InputError
from dicflow.io.images.formats import is_video
from dicflow.io.images.reading import read_grey

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.motion.survey import Survey

__all__ = ["survey_of"]

_FORM = 1
"""Raised whenever a look at the same photographs may find something else."""
_MOST_KEPT = 200
"""Looks that are kept; of more, those used last."""


def survey_of(files: Sequence[Path | FilePart]) -> Survey:
    """What a look at photographs of one camera finds, in their order.

    Raises InputError that names a photograph that cannot be read, or has another size than the first.
    """
    unchanged = {os.path.abspath(file): list(stamp(file)) for file in files}
    numbers = [[os.path.abspath(file), file.number if isinstance(file, FilePart) else 0] for file in files]
    return _survey(tuple(files), digest_json([_FORM, unchanged, numbers]))


@lru_cache(maxsize=8)
def _survey(files: tuple[Path | FilePart, ...], digest: str) -> Survey:
    from dicflow.core.motion.survey import survey

    folder = account_folder()
    kept = None if folder is None else folder / "surveys" / f"{digest[7:39]}.npz"
    found = None if kept is None else _kept(kept)
    if found is None:
        found = survey(_frames(files))
        if kept is not None:
            _keep(kept, found)
    return found


def _frames(files: Sequence[Path | FilePart]) -> Iterator[np.ndarray]:
    """Grey levels of all; in place of a frame of a video that cannot be decoded stands the one before it."""
    before: np.ndarray | None = None
    for file in files:
        try:
            before = read_grey(file)
        except InputError:
            if before is None or not (isinstance(file, FilePart) and is_video(file.path)):
                raise
        yield before


def _kept(path: Path) -> Survey | None:
    import numpy as np

    from dicflow.core.motion.survey import Survey

    try:
        with np.load(path, allow_pickle=False) as found:
            kept = Survey(*(found[name] for name in Survey._fields))
        os.utime(path)
    except Exception:  # missing or damaged: the photographs are looked at again
        return None
    return kept


def _keep(path: Path, survey: Survey) -> None:
    """Keep a look; a full disk is ignored here, since it only costs time."""
    import numpy as np

    with suppress(OSError):
        path.parent.mkdir(exist_ok=True)
        content = BytesIO()
        np.savez_compressed(content, **survey._asdict())
        write_file(path, content.getvalue())
        for old in sorted(path.parent.iterdir(), key=lambda one: -one.stat().st_mtime)[_MOST_KEPT:]:
            old.unlink()
