"""Other processes, and waiting for what they do: patience costs nothing where the machine is quick."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

__all__ = ["PATIENCE_S", "started", "until"]

PATIENCE_S = 120.0


@contextmanager
def started(command: Sequence[Any], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """A process that ends with the block, also where a check in it fails. options : of Popen"""
    with subprocess.Popen(command, **options) as process:
        try:
            yield process
        finally:
            process.kill()


def until(condition: Callable[[], Any], patience_s: float = PATIENCE_S) -> Any:
    """Wait for a condition, and return its first true value."""
    end = time.monotonic() + patience_s
    while not (found := condition()):
        assert time.monotonic() < end, condition
        time.sleep(0.05)
    return found
