"""How evenly two workers share a run of many tasks: toy photographs, a chain over all steps, an independent stage.

Run it alone with ``python -m tests.bench_flow``.
"""

from __future__ import annotations

import hashlib
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

from dicflow.engine.execute import Options, RunResult, run
from dicflow.engine.graph import Graph, StageSpec, expand
from dicflow.engine.journal import Event
from dicflow.engine.node import At, Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.engine.store import Store
from dicflow.engine.work import Outcome
from tests.bars import Figure
from tests.figures import fresh, report

STEPS = 700
WORKERS = 2
_BLOCK = bytes(1 << 20)


class _Busy(Node):
    """A stage that keeps one core busy."""

    work_s: float = parameter(0.02, "time in the stage [s]", affects="speed")

    def product(self, kind: str, *sources: Any) -> Product:
        """Work beside the interpreter, as compiled code does, and give a product without arrays."""
        end = time.perf_counter() + self.work_s
        while time.perf_counter() < end:
            hashlib.sha256(_BLOCK)
        return Product(kind, attrs={"sources": [str(source) for source in sources]})


class Photographs(_Busy):
    """Per step: reads a file."""

    title: ClassVar = "photographs"
    scope: ClassVar = Scope.STEP
    gives: ClassVar = "photograph"
    stage: Literal["photographs"] = "photographs"

    def steps(self, folder: Path) -> Mapping[str, Mapping[str, Path]]:
        """One step per file."""
        return {path.stem: {"source": path} for path in sorted(folder.iterdir())}

    def run(self, source: Path) -> Product:
        """What is in the file."""
        return self.product("photograph", source.read_text())


class Chained(_Busy):
    """Per step: takes its own output of the step before."""

    title: ClassVar = "chained"
    scope: ClassVar = Scope.STEP
    gives: ClassVar = "chained"
    takes: ClassVar = {"photograph": Port("photograph"), "before": Port("chained", at=At.PREVIOUS, own=True)}
    stage: Literal["chained"] = "chained"

    def run(self, photograph: Product, before: Product | None) -> Product:
        """The number of the step in the chain."""
        number = 0 if before is None else int(before.attrs["sources"][0]) + 1
        return self.product("chained", number, *photograph.attrs["sources"])


class Independent(_Busy):
    """Per step: takes the photograph only."""

    title: ClassVar = "independent"
    scope: ClassVar = Scope.STEP
    gives: ClassVar = "independent"
    takes: ClassVar = {"photograph": Port("photograph")}
    stage: Literal["independent"] = "independent"

    def run(self, photograph: Product) -> Product:
        """What the photograph holds."""
        return self.product("independent", *photograph.attrs["sources"])


def three_stages(folder: Path, steps: int) -> Graph:
    """Photographs → a chain, and a stage beside it."""
    folder.mkdir(parents=True)
    for step in range(steps):
        (folder / f"step_{step:05}.txt").write_text(str(step))
    inputs = {"photograph": "photographs"}
    return expand({
        "photographs": StageSpec(Photographs(), {}, folder),
        "chained": StageSpec(Chained(), inputs),
        "independent": StageSpec(Independent(), inputs),
    })  # fmt: skip


def ideal_s(result: RunResult) -> float:
    """Time that an even flow needs [s]: half of all work, but no less than the chain alone."""
    spent = {name: one.stage_s + one.remake_s + one.engine_s for name, one in result.outcomes.items()}
    chain = sum(seconds for name, seconds in spent.items() if result.outcomes[name].stage == "chained")
    return max(sum(spent.values()) / WORKERS, chain)


def _stage_s(outcome: Outcome) -> float:
    return outcome.stage_s


def figures(steps: int = STEPS) -> Iterator[Figure]:
    """Wall time of a run with a chained stage, against the time of an even flow."""
    folder = fresh("bench_flow")
    graph, ended = three_stages(folder / "files", steps), []

    def on_event(event: Event) -> None:
        if event.kind == "finished":
            ended.append(time.perf_counter())

    options = Options("processes", WORKERS, on_event=on_event)
    result = run(graph, Store.open(folder / "store"), options=options)
    wall = ended[-1] - ended[0]
    name = f"{len(result.outcomes):,} tasks, a third of them a chain, {WORKERS} workers"
    yield Figure(f"{name}: wall time", wall, unit="s")
    yield Figure(f"{name}: wall time / even flow", wall / ideal_s(result), 1.1)
    yield Figure(f"{name}: wall time / work alone", wall / (sum(map(_stage_s, result.outcomes.values())) / WORKERS))


if __name__ == "__main__":
    sys.exit(report(figures(*map(int, sys.argv[1:]))))
