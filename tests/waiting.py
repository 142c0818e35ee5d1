"""Waiting for something that another process does."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any


def until(condition: Callable[[], Any], patience_s: float = 120.0) -> Any:
    """Wait for a condition, and return its first true value."""
    end = time.monotonic() + patience_s
    while not (found := condition()):
        assert time.monotonic() < end, condition
        time.sleep(0.05)
    return found
