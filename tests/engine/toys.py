"""Small stages on numbers, with which the engine is tested: it knows nothing of images."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

from dicflow.engine.execute import Options, RunResult, run
from dicflow.engine.graph import Graph, StageSpec, expand
from dicflow.engine.node import At, InputFile, Millimetres, Node, Port, Scope, parameter
from dicflow.engine.product import Product, Variable
from dicflow.engine.store import Store
from dicflow.engine.stored_json import anything, read_stored, seal
from dicflow.errors import InputError, StageError


def field(kind: str, values: Any, **attrs: Any) -> Product:
    """A product with one array."""
    import numpy as np

    return Product(
        kind, {"values": Variable(("row",), np.asarray(values, dtype=np.float64), "mm", "some values")}, attrs
    )


class Read(Node):
    """One step per file; each holds one number and perhaps a comment."""

    title: ClassVar = "read numbers"
    scope: ClassVar = Scope.STEP
    gives: ClassVar = "number"
    stage: Literal["read"] = "read"
    pattern: str = parameter("*.txt", "files", affects="speed")
    size: int = parameter(10, "length of the array")

    def steps(self, folder: Path) -> Mapping[str, Mapping[str, Path]]:
        """One step per file."""
        return {path.stem: {"source": path} for path in sorted(folder.glob(self.pattern))}

    def check(self, path: Path) -> dict[str, Any]:
        """Refuses a file that holds no number."""
        words = path.read_text().split()
        try:
            return {"value": float(words[0]), "words": len(words)}
        except (ValueError, IndexError) as error:
            raise InputError(f"{path}: holds no number; write one") from error

    def agree(
        self,
        facts: Mapping[Path, Mapping[str, Any]],
        steps: Mapping[str, Mapping[str, Path]],
        inputs: Mapping[str, tuple[str, ...]],
    ) -> None:
        """Refuses files above a million."""
        for path, fact in facts.items():
            if fact["value"] > 1e6:
                raise InputError(f"{path}: too large beside the others")

    def run(self, source: Path) -> Product:
        """The number, several times."""
        return field("number", [float(source.read_text().split()[0])] * self.size)


class Rig(Node):
    """Once: the mean of all steps, without arrays."""

    title: ClassVar = "mean"
    scope: ClassVar = Scope.RIG
    gives: ClassVar = "rig"
    takes: ClassVar = {"numbers": Port("number", at=At.ALL)}
    stage: Literal["rig"] = "rig"

    def run(self, numbers: Any) -> Product:
        """The mean, and the names of the steps."""
        total = sum(float(number["values"].mean()) for number in numbers)
        return Product("rig", attrs={"mean": total / len(numbers), "steps": list(numbers.steps)})


class Scale(Node):
    """Per step: a multiple of the number."""

    title: ClassVar = "scale"
    scope: ClassVar = Scope.STEP
    gives: ClassVar = "number"
    takes: ClassVar = {"number": Port("number"), "rig": Port("rig", optional=True)}
    stage: Literal["scale"] = "scale"
    factor: float = parameter(2.0, "factor")
    length: Millimetres = parameter(20.0, "a length", unit="mm")
    table: InputFile | None = parameter(None, "a file with one number to add")
    threads: int = parameter(1, "only speed", affects="speed")
    sleep_s: float = parameter(0.0, "pretended work", affects="speed")

    def run(self, number: Product, rig: Product | None, table_path: Path | None = None) -> Product:
        """The multiple."""
        time.sleep(self.sleep_s)
        added = float(table_path.read_text()) if table_path is not None else 0.0
        return field("number", number["values"] * self.factor + added, summary={"first": number["values"][0]})


class Clip(Node):
    """Per step: the number, but no more than a limit; so other inputs may give the same output."""

    title: ClassVar = "clip"
    scope: ClassVar = Scope.STEP
    gives: ClassVar = "number"
    takes: ClassVar = {"number": Port("number")}
    stage: Literal["clip"] = "clip"
    limit: float = parameter(5.0, "largest value")

    def run(self, number: Product) -> Product:
        """The clipped number."""
        import numpy as np

        return field("number", np.minimum(number["values"], self.limit))


class Difference(Node):
    """Per pair: this step less the one before."""

    title: ClassVar = "difference"
    scope: ClassVar = Scope.PAIR
    gives: ClassVar = "difference"
    takes: ClassVar = {"before": Port("number", at=At.PREVIOUS), "now": Port("number")}
    stage: Literal["difference"] = "difference"

    def run(self, before: Product, now: Product) -> Product:
        """The difference."""
        return field("difference", now["values"] - before["values"])


class Total(Node):
    """Per pair: the sum of all differences so far."""

    title: ClassVar = "total"
    scope: ClassVar = Scope.PAIR
    gives: ClassVar = "total"
    takes: ClassVar = {
        "difference": Port("difference"),
        "so_far": Port("total", at=At.PREVIOUS, own=True),
        "first": Port("number", at=At.FIRST, optional=True),
    }
    stage: Literal["total"] = "total"

    def run(self, difference: Product, so_far: Product | None, first: Product | None) -> Product:
        """The sum."""
        values = difference["values"] if so_far is None else so_far["values"] + difference["values"]
        return field("total", values, has_first=first is not None)


class Report(Node):
    """Once: the last total."""

    title: ClassVar = "report"
    scope: ClassVar = Scope.TEST
    gives: ClassVar = "report"
    takes: ClassVar = {"totals": Port("total", at=At.ALL)}
    stage: Literal["report"] = "report"

    def run(self, totals: Any) -> Product:
        """A number."""
        return Product("report", attrs={"last": float(totals[-1]["values"][0]), "steps": list(totals.steps)})


class Trouble(Node):
    """Per step: fails in the way that is asked for, at the steps with a number above a limit."""

    title: ClassVar = "trouble"
    scope: ClassVar = Scope.STEP
    gives: ClassVar = "number"
    takes: ClassVar = {"number": Port("number")}
    stage: Literal["trouble"] = "trouble"
    how: Literal["stage", "defect", "kill", "kill once", "kill twice", "flaky", "kind", "interrupt"] = parameter(
        "stage", "which"
    )
    above: float = parameter(2.0, "limit")
    marks: str = parameter("", "folder for marks", affects="speed")

    def run(self, number: Product) -> Product:
        """Fails, or passes the number on."""
        if number["values"][0] <= self.above:
            return field("number", number["values"])
        mark = Path(self.marks) / f"{number['values'][0]:.0f}"
        with mark.open("ab") as file:
            file.write(b".")
        attempt = mark.stat().st_size
        first = attempt == 1
        if self.how == "stage":
            raise StageError("the number is too large; use a smaller one")
        if self.how == "defect" or (self.how == "flaky" and first):
            raise ZeroDivisionError("a defect")
        if self.how == "kill" or attempt <= {"kill once": 1, "kill twice": 2}.get(self.how, 0):
            os.kill(os.getpid(), signal.SIGKILL)
        if self.how == "interrupt":
            os.kill(os.getpid(), signal.SIGINT)
        return field("other" if self.how == "kind" else "number", number["values"])


def numbers(folder: Path, count: int = 6) -> Path:
    """A folder of files 1 … count, changed some time ago."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(1, count + 1):
        write(folder / f"step_{number:02d}.txt", str(number))
    return folder


def edit_json(path: Path, **changes: Any) -> None:
    """Change entries of a file of the store, as the store itself would write it."""
    path.write_bytes(seal({**read_stored(path, anything), **changes}))


def write(path: Path, text: str, age_s: float = 60.0) -> None:
    """Write a file as if its contents had been changed some time ago."""
    path.write_text(text)
    then = time.time() - age_s
    os.utime(path, (then, then))


def chain(folder: Path, keep: str = "auto", **parameters: Any) -> Graph:
    """Files → rig and scaled numbers → differences → totals → report. For 6 files 24 tasks."""
    scale = Scale(keep=keep, **parameters)
    return expand(
        {
            "read": StageSpec(Read(keep=keep), {}, folder),
            "rig": StageSpec(Rig(), {"numbers": "read"}),
            "scale": StageSpec(scale, {"number": "read", "rig": "rig"}, folder),
            "difference": StageSpec(Difference(keep=keep), {"before": "scale", "now": "scale"}),
            "total": StageSpec(Total(), {"difference": "difference", "first": "read"}),
            "report": StageSpec(Report(), {"totals": "total"}),
        }
    )


def run_sync(graph: Graph, store: Store, **options: Any) -> RunResult:
    """Run in this process, under the pipeline name "toys"."""
    return run(graph, store, pipeline="toys", options=Options(**{"scheduler": "sync", **options}))


class Threads(Node):
    """Per step: how many threads the libraries may use in this worker."""

    title: ClassVar = "threads"
    scope: ClassVar = Scope.STEP
    gives: ClassVar = "threads"
    takes: ClassVar = {"number": Port("number")}
    stage: Literal["threads"] = "threads"

    def run(self, number: Product) -> Product:
        """The numbers of threads."""
        import cv2
        import numba

        return Product("threads", attrs={"cv2": cv2.getNumThreads(), "numba": numba.get_num_threads()})
