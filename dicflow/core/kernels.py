"""How kernels are compiled."""

from __future__ import annotations

__all__ = ["INNER"]

INNER = {"nogil": True, "no_cfunc_wrapper": True, "forceinline": True}
"""Options of a function that kernels call: no file of its own is kept, and no entrance from C. Python may call it.

Its code becomes part of each kernel. Else it would be a function of each kernel, compiled a little differently in each,
of which a process takes the one that it loads first: results would depend in their last digits on what else a process
has loaded or compiled.
"""
