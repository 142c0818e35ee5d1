"""How kernels are compiled."""

from __future__ import annotations

from numba.np import linalg

__all__ = ["INNER", "KERNEL", "MAKER"]


def _load_without_scipy() -> None:
    """Load the arrays of numba, which loads all of scipy's linear algebra to see whether it is there.

    That takes 0.14 s, more than the kernels, none of which needs it. One that did would load it where it is compiled.
    The name is numba's own: a version that lacks it loads everything.
    """
    look = getattr(linalg, "ensure_blas", None)
    if look is None:
        return
    linalg.ensure_blas = lambda: None
    try:
        import numba.np.arraymath  # noqa: F401
    finally:
        linalg.ensure_blas = look


_load_without_scipy()

KERNEL = {"cache": True, "nogil": True, "no_cfunc_wrapper": True, "_nrt": True}
"""Options of a function that Python calls: it is kept, other threads go on meanwhile, and it has no entrance from C.

Whether it counts references is said in so many words, since numba lets a function inherit that from its caller."""
INNER = {"nogil": True, "no_cfunc_wrapper": True, "no_cpython_wrapper": True, "forceinline": True, "_nrt": False}
"""Options of a function that only kernels call: no file of its own is kept, and it has no entrance of its own.

Its code becomes part of each kernel. Else it would be a function of each kernel, compiled a little differently in each,
of which a process takes the one that it loads first: results would depend in their last digits on what else a process
has loaded or compiled. An entrance from Python would take a sixth of the time of compiling.

It counts no references, as its caller holds all arrays: two for every array at each call took a quarter of the search
for a subset, since threads wait for each other's. So it must not return an array, which its caller would give up, nor
a tuple with one; one that makes an array does not compile.
"""
MAKER = {**INNER, "_nrt": True}
"""Options of an inner function that makes arrays, or returns one."""
