"""Threads that a test has left behind: they could change files of the next test, or what that counts."""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path
from types import FrameType

import dicflow

__all__ = ["wait_for_threads"]

_PACKAGE = str(Path(dicflow.__file__).parent)


def wait_for_threads(patience_s: float) -> None:
    """Wait until no other thread is in a function of dicflow. Raises AssertionError where one goes on for long."""
    end = time.monotonic() + patience_s
    while at_work := _at_work():
        assert time.monotonic() < end, f"threads go on behind their test: {', '.join(at_work)}"
        time.sleep(0.01)


def _at_work() -> list[str]:
    """Other threads that are in a function of dicflow, each with the place."""
    frames = sys._current_frames()
    others = (thread for thread in threading.enumerate() if thread is not threading.current_thread())
    places = [(thread.name, _place(frames.get(thread.ident or 0))) for thread in others]
    return [f"{name} at {place}" for name, place in places if place]


def _place(frame: FrameType | None) -> str:
    """Where a thread is in dicflow, "" where it is elsewhere."""
    while frame is not None:
        if frame.f_code.co_filename.startswith(_PACKAGE):
            return f"{frame.f_code.co_filename}:{frame.f_lineno}"
        frame = frame.f_back
    return ""
