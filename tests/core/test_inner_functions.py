"""Functions that kernels call are part of each kernel, so that no kernel runs what another one was compiled to."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator

from numba.core.registry import CPUDispatcher

import dicflow.core


def kernels() -> Iterator[CPUDispatcher]:
    """All compiled functions of the core that measure; those that render must not change a byte of data_samples."""
    for module in pkgutil.walk_packages(dicflow.core.__path__, "dicflow.core."):
        if module.name.startswith("dicflow.core.synthetic"):
            continue
        for name, found in vars(importlib.import_module(module.name)).items():
            if isinstance(found, CPUDispatcher) and found.py_func.__module__ == module.name and name != "njit":
                yield found


def test_what_a_kernel_calls_is_inlined():
    calls = 0
    for kernel in kernels():
        code, names = kernel.py_func.__code__, kernel.py_func.__globals__
        for name in code.co_names:
            if isinstance(names.get(name), CPUDispatcher):
                calls += 1
                assert names[name].targetoptions.get("forceinline"), f"{kernel.py_func.__name__} calls {name}"
    assert calls > 50
