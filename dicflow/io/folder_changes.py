"""Folders in which files come and go: woken by the system, and by the clock where it does not tell."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from pathlib import Path

__all__ = ["FolderChanges"]

_GATHERED_MS, _QUIET_MS, _LOOK_MS = 100, 20, 1000
"""Changes are gathered for so long at most, until none comes for so long; and the folders are looked for so often."""


class FolderChanges:
    """Waits for changes in folders and below. Use it as a context.

    folders : they may come later, and vanish
    beside : a folder whose changes do not count
    Changes that another machine makes on a shared disk are not reported by the system, so that a caller looks by itself
    now and then.
    """

    def __init__(self, folders: Iterable[Path], beside: Path) -> None:
        self._folders = tuple(folders)
        self._beside = beside
        self._changed = threading.Event()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> FolderChanges:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ended.set()
        self._thread.join()

    def wait(self, seconds: float) -> bool:
        """Wait for a change, at most so long; returns whether there was one."""
        changed = self._changed.wait(seconds)
        if changed:  # one that comes just after the time is up is for the next call
            self._changed.clear()
        return changed

    def missing(self) -> list[Path]:
        """The folders that are not there."""
        return [folder for folder in self._folders if not folder.is_dir()]

    def _watch(self) -> None:
        while not self._ended.is_set():
            found = _numbers(self._folders)
            if found:
                self._watch_while(found)
            else:
                self._ended.wait(_LOOK_MS / 1000)

    def _watch_while(self, found: dict[Path, int]) -> None:
        """Report changes until a folder is replaced, comes or goes."""
        from watchfiles import watch

        changes = watch(
            *found,
            watch_filter=lambda _, path: not Path(path).is_relative_to(self._beside),
            debounce=_GATHERED_MS,
            step=_QUIET_MS,
            rust_timeout=_LOOK_MS,
            yield_on_timeout=True,
            stop_event=self._ended,
            raise_interrupt=False,
        )
        try:
            for batch in changes:
                if batch:
                    self._changed.set()
                if _numbers(self._folders) != found:
                    break
        except OSError:  # a folder went while its watch began
            self._ended.wait(_LOOK_MS / 1000)
        self._changed.set()


def _numbers(folders: Iterable[Path]) -> dict[Path, int]:
    """The folders that are there, each with the number by which the file system knows it."""
    found = {}
    for folder in folders:
        try:
            found[folder] = folder.stat().st_ino
        except OSError:
            continue
    return found
