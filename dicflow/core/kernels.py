"""How kernels are compiled."""

from __future__ import annotations

__all__ = ["INNER"]

INNER = {"nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of a function that kernels alone call: nothing is kept of it, and it is compiled sooner.

It has no entrance from Python: a call from there ends the process. Python may call its ``py_func``.
"""
