"""Slow parts of a report, kept beside it from one build to the next, each behind its check sum."""

from __future__ import annotations

import hashlib
import json
import re
import zlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from dicflow.engine.whole_file import read_file
from dicflow.io.files import write_whole

__all__ = ["Pieces"]

_PIECE = re.compile(r"[0-9a-f]{64}")


class Pieces:
    """A folder of pieces, each under the digest of what it was made of. Threads may share it.

    folder : made with the first piece; it can be deleted, since pieces are made again
    code : digest of the code that makes the pieces, :func:`dicflow.views.source_digest.source_digest`
    """

    def __init__(self, folder: Path, code: str) -> None:
        self._folder, self._code = folder, code
        self._asked: set[str] = set()

    def get(self, sources: Sequence[str], make: Callable[[], bytes]) -> bytes:
        """The piece made of these sources, from the folder or else from ``make``.

        sources : everything that the piece depends on but the code: its name, digests of products, looks as JSON
        Raises InputError where it cannot be written.
        """
        key = hashlib.sha256(json.dumps([self._code, *sources]).encode()).hexdigest()
        self._asked.add(key)
        with suppress(OSError, ValueError):
            return _unsealed(read_file(self._folder / key))
        content = make()
        write_whole(self._folder / key, _check_sum(content) + content)
        return content

    def drop_unused(self) -> None:
        """Delete the pieces that were not read since this object was made."""
        if self._folder.is_dir() and not self._folder.is_symlink():
            for path in self._folder.iterdir():
                if _PIECE.fullmatch(path.name) and path.name not in self._asked:
                    with suppress(OSError):
                        path.unlink()


def _check_sum(content: bytes) -> bytes:
    return b"%08x" % zlib.crc32(content)


def _unsealed(stored: bytes) -> bytes:
    """What stands behind the check sum. Raises ValueError if it is damaged."""
    content = stored[8:]
    if stored[:8] != _check_sum(content):
        raise ValueError("the check sum differs")
    return content
