"""How kernels are compiled."""

from __future__ import annotations

__all__ = ["INNER"]

INNER = {"nogil": True, "no_cfunc_wrapper": True}
"""Options of a function that kernels call: no file of its own is kept, and no entrance from C. Python may call it."""
