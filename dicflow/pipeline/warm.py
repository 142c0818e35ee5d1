"""What the first run on a machine does once, done ahead: compiling, and reading the source of the stages."""

from __future__ import annotations

import compileall
import time
from collections.abc import Iterator
from pathlib import Path

from dicflow.engine.fingerprint import Sources, kept_sources
from dicflow.engine.kernel_cache import kernel_mark
from dicflow.engine.processes import WorkerProcesses
from dicflow.errors import ConfigurationError
from dicflow.pipeline.registry import node_classes
from dicflow.stages._kernels import KERNELS, compile_kernels

__all__ = ["warm"]


def warm(workers: int = 1) -> Iterator[str]:
    """Compile what is not kept yet: modules and kernels; read the source of all stages. Gives a line for each.

    workers : processes that compile kernels at once
    Raises ConfigurationError where neither kernels nor what is known of the source can be kept.
    """
    kept, marks = kept_sources(), {name: kernel_mark(name) for name in KERNELS}
    if kept is None or None in marks.values():
        raise ConfigurationError("no folder for compiled kernels can be written; name one with NUMBA_CACHE_DIR")
    missing = [name for name, mark in marks.items() if mark is not None and not mark.exists()]
    if missing:
        with WorkerProcesses(min(workers, len(missing))) as processes:
            yield from processes.map(_compiled, missing)
    yield _compiled_modules()
    start = time.perf_counter()
    sources = Sources(kept)
    for node in node_classes()[0].values():
        sources.fingerprint(node)
    sources.save()
    yield f"source of the stages: {time.perf_counter() - start:.1f} s"


def _compiled_modules() -> str:
    """Keep the bytecode of dicflow's modules beside them, as pip does for those that it copies.

    An editable installation has none at first, and gets none where Python runs with ``PYTHONDONTWRITEBYTECODE``. Where
    it cannot be written, each process compiles what it imports.
    """
    start = time.perf_counter()
    compileall.compile_dir(Path(__file__).parents[1], quiet=2)
    return f"modules: {time.perf_counter() - start:.1f} s"


def _compiled(name: str) -> str:
    start = time.perf_counter()
    compile_kernels([name])
    return f"kernels, {name}: {time.perf_counter() - start:.1f} s"
