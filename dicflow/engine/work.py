"""What a worker does with one task: look again, run the stage, keep the product, and report in a few bytes.

Who tries again? A :class:`Defect` leaves this module as an exception, and the backend that handed the task over counts
its attempts: dask's scheduler by ``retries``, since it outlives a worker and may choose another one, and
:mod:`dicflow.engine.local` for jobs on this machine. A DicflowError would come again, so that it is an outcome.
"""

from __future__ import annotations

import os
import platform
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from dicflow.engine.action_index import action_of
from dicflow.engine.file_stamps import FileStamp
from dicflow.engine.files import FilePart, part_digest, stamp
from dicflow.engine.fingerprint import Fingerprint
from dicflow.engine.graph import Task
from dicflow.engine.hashing import digest_file
from dicflow.engine.journal import Status
from dicflow.engine.keys import input_digests, key_of, key_parts
from dicflow.engine.looks import looks_product, with_looks
from dicflow.engine.node import At, Node
from dicflow.engine.objects import Manifest, describe, normalised
from dicflow.engine.plan import CodePolicy, code_warning, find_hit
from dicflow.engine.product import Product
from dicflow.engine.records import Record, versions
from dicflow.engine.references import Recipe, Ref, arguments, clock, handover, recipe_of
from dicflow.engine.references import cache as products
from dicflow.engine.share import with_threads
from dicflow.engine.store import Store
from dicflow.engine.workers import hold_to_one_thread
from dicflow.errors import DamagedError, DicflowError, InputError, StageError

__all__ = ["KILLED", "Defect", "Job", "Outcome", "Perform", "is_kept", "perform", "stop_path"]

KILLED = "its worker was killed every time, even running alone; probably out of memory"
"""The error of a task whose workers die."""
_DEEPEST = 3
"""Products that are not kept may rest on one another this deep."""
_PER_ARRAY_S, _BYTES_PER_S = 0.001, 2e8
"""What keeping costs: per array [s], and bytes written and read again per second."""
_WORTH = 5.0
"""A product is kept when making it took so many times longer than keeping it."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a task. It travels in the place of the product.

    status : hit (found when its turn came), computed, failed, or skipped
    stage_s : in the stage itself [s]; remake_s : making again inputs that were not kept; engine_s : hashing, reading
        and storing
    cpu_s, stage_cpu_s : processor time of all of it, and of the stage with the reading of its inputs [s]
    peak_bytes : most memory that its process held while it ran
    worker : id of the process that did it; one that computed has the product in its memory, for a while
    damaged : failed because an input's object turned out damaged; another run repairs it
    warning : of a hit that other code has made
    warnings : of the product
    """

    name: str
    stage: str
    step: str | None
    status: Status
    ref: Ref | None = None
    key: str = ""
    error: str = ""
    stage_s: float = 0.0
    remake_s: float = 0.0
    engine_s: float = 0.0
    cpu_s: float = 0.0
    stage_cpu_s: float = 0.0
    peak_bytes: int = 0
    worker: int = 0
    damaged: bool = False
    warning: str = ""
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Job:
    """Everything that a worker needs to know of a task.

    store : folder of the store
    known : producers that were hits in the plan
    files : argument of ``run`` → contents
    code : fingerprint of the stage; the store knows its parts
    gathered : whether a stage takes this product together with those of all other steps
    threads : that the stage may use, because no other task can
    handover : folder through which products that are not kept reach the other workers; None without others
    """

    run_id: str
    store: Path
    task: Task
    parameters: Mapping[str, Any]
    known: Mapping[str, Ref]
    files: Mapping[str, FileStamp]
    code: Fingerprint
    gathered: bool = False
    code_policy: CodePolicy = "recompute"
    threads: int = 1
    handover: Path | None = None

    @property
    def key(self) -> tuple[str, ...]:
        """Name in dask's graph: (stage, step, run), or (stage, run) of a stage that runs once."""
        task = self.task
        return (task.stage, self.run_id) if task.step is None else (task.stage, task.step, self.run_id)

    def awaited(self) -> list[str]:
        """Names of the producers that were no hits in the plan."""
        return [name for name in self.task.producers() if name not in self.known]

    def known_inputs(self, outcomes: Mapping[str, Outcome]) -> list[Outcome]:
        """The outcomes among those given that :func:`perform` takes."""
        return [outcomes[name] for name in self.awaited() if name in outcomes]

    def workers(self, outcomes: Mapping[str, Outcome]) -> list[int]:
        """Ids of the processes that have inputs in their memory that others would make again, that of most first."""
        made = (outcome for outcome in self.known_inputs(outcomes) if outcome.worker)
        near = Counter(outcome.worker for outcome in made if outcome.ref is not None and outcome.ref.recipe is not None)
        return [worker for worker, _ in near.most_common()]

    def workers_before(self, outcomes: Mapping[str, Outcome]) -> list[int]:
        """Ids of the processes that computed the stage's own products of earlier steps, which others would read."""
        own = {self.task.inputs[port] for port, declared in self.task.node.takes.items() if declared.own}
        made = (outcome for outcome in self.known_inputs(outcomes) if outcome.status == "computed")
        return [outcome.worker for outcome in made if outcome.worker and outcome.name in own]

    def outcome(self, status: Status, **more: Any) -> Outcome:
        """An outcome of this task."""
        return Outcome(self.task.name, self.task.stage, self.task.step, status, **more)


Perform = Callable[..., Outcome]
"""Does a job with the outcomes of its producers, like :func:`perform`."""


class Defect(Exception):
    """An error in a stage that is not a DicflowError; its text is the message for the outcome."""


def stop_path(store: Path, run_id: str) -> Path:
    """The file that, once it exists, keeps all workers of a run from starting another task."""
    return store / "runs" / run_id / "stop"


def perform(job: Job, *inputs: Outcome) -> Outcome:
    """Do one task.

    inputs : outcomes of the producers that were no hits in the plan
    Raises Defect where the stage raised an error that is not a DicflowError; a DicflowError is part of the outcome.
    """
    processor, handover.folder = _clock(job), job.handover
    start, cpu_start = time.perf_counter(), processor()
    lacking = next((outcome for outcome in inputs if outcome.ref is None), None)
    if lacking is not None:
        return job.outcome("skipped", error=f"{lacking.name} {lacking.status}")
    if stop_path(job.store, job.run_id).exists():
        return job.outcome("skipped", error="the run was stopped")
    try:
        done = _performed(job, inputs, start)
        return replace(done, cpu_s=processor() - cpu_start, worker=os.getpid())
    except DicflowError as error:
        return job.outcome("failed", error=_with_task(job, error), damaged=isinstance(error, DamagedError))
    except Exception as error:
        raise Defect(_defect(job, error)) from error


def is_kept(node: Node, arrays: int, nbytes: int, seconds: float, depth: int, gathered: bool = False) -> bool:
    """Whether a product is stored, or made again by those who use it.

    arrays, nbytes : number and size of its arrays in memory
    seconds : what making it took
    depth : how many stages must run to make it again
    gathered : whether a stage takes it together with those of all other steps

    Chains of steps and products of whole series are always kept, so that nothing needs a long way to be made again; so
    are those that are gathered, which one worker would make again one by one while the others have nothing to do.
    """
    chained = any(port.own or port.at is At.ALL for port in node.takes.values())
    if node.keep == "always" or chained or depth > _DEEPEST:
        return True
    return node.keep == "auto" and (gathered or seconds > _WORTH * (arrays * _PER_ARRAY_S + nbytes / _BYTES_PER_S))


def _performed(job: Job, inputs: tuple[Outcome, ...], start: float) -> Outcome:
    store, task = _store(job.store), job.task
    refs = {**job.known, **{outcome.name: outcome.ref for outcome in inputs if outcome.ref is not None}}
    recipe = recipe_of(task, refs)
    digests = {name: file.digest for name, file in job.files.items()}
    parts = key_parts(task.node, job.parameters, input_digests(recipe.inputs), digests, task.is_look)
    key = key_of(parts)
    record, kept, against = find_hit(store, key, job.code, job.code_policy)
    if record is not None and not against:
        ref = Ref(record.digest, None if kept else recipe)
        if record.made.get("run") == job.run_id:  # done before by a worker that died of something else
            stage_s = record.made.get("stage_s", 0.0)
            return job.outcome("computed", ref=ref, key=key, stage_s=stage_s, warnings=record.warnings)
        warning = code_warning(store, task.stage, record, job.code, job.code_policy)
        return job.outcome("hit", ref=ref, key=key, warning=warning, warnings=record.warnings)
    product, times, stage_cpu_s = _run(job, store, recipe)
    with with_threads(job.threads):
        manifest = describe(product)
        keep = task.is_look or is_kept(
            task.node, len(product.variables), manifest.nbytes, sum(times), recipe.depth, job.gathered
        )
        manifest = store.put(product, manifest, keep)
    products.put(manifest.digest, product, manifest.nbytes, manifest.kept)
    if not manifest.kept:
        handover.put(product, manifest)
    ref = Ref(manifest.digest, None if manifest.kept else recipe)
    stage_s, remake_s = times
    engine_s = time.perf_counter() - start - stage_s - remake_s
    done = job.outcome(
        "computed",
        ref=ref,
        key=key,
        stage_s=stage_s,
        remake_s=remake_s,
        engine_s=engine_s,
        stage_cpu_s=stage_cpu_s,
        peak_bytes=_peak(),
        warnings=product.warnings,
    )
    made = Record(key, parts, manifest.digest, job.code.root, _provenance(job, done, manifest))
    store.put_record(made)
    store.index.append([(key, action_of(made, manifest))])
    return replace(done, engine_s=time.perf_counter() - start - stage_s - remake_s)


def _run(job: Job, store: Store, recipe: Recipe) -> tuple[Product, tuple[float, float], float]:
    """The product, the seconds spent in the stage and in making its inputs again, and the stage's processor time.

    The stage's processor time contains that of reading its inputs, which happens while it runs.
    """
    node = job.task.node
    hold_to_one_thread()
    _reset_peak()
    start, read, remade = time.perf_counter(), clock.read_s, clock.remake_s
    given = arguments(store, recipe.inputs, recipe.files)
    processor = _clock(job)
    cpu_start = processor()
    with with_threads(job.threads):
        product = looks_product(node, given) if job.task.is_look else node.run(**with_looks(node, given))
    remake_s = clock.remake_s - remade
    stage_s = time.perf_counter() - start - remake_s - (clock.read_s - read)
    stage_cpu_s = processor() - cpu_start
    if not isinstance(product, Product) or (product.kind != node.gives and not job.task.is_look):
        found = f"a product '{product.kind}'" if isinstance(product, Product) else type(product).__name__
        raise StageError(f"the stage '{node.stage}' gave {found} where it declares '{node.gives}'; fix the stage")
    for name, file in job.files.items():
        if _has_changed(node, job.task.files[name], file):
            raise InputError(f"{job.task.files[name]}: changed during the run; run again once nothing is writing it")
    return normalised(product), (stage_s, remake_s), stage_cpu_s


def _clock(job: Job) -> Callable[[], float]:
    """Processor time of all that does a job: its thread, or the process that it has for itself [s]."""
    return time.process_time if job.threads > 1 else time.thread_time


def _has_changed(node: Node, file: Path | FilePart, known: FileStamp) -> bool:
    """Whether a file's contents are not what they were. A new stamp alone is no change: a backup may set its times."""
    if stamp(file) == known.stamp:
        return False
    try:
        digest = _part_digest(node, file) if isinstance(file, FilePart) else digest_file(file)
    except (OSError, InputError):
        return True
    return bool(digest != known.digest)


def _part_digest(node: Node, part: FilePart) -> str:
    digest: str | None = node.check(part).get("digest")
    return digest or part_digest(digest_file(part.path), part.number)


def _provenance(job: Job, done: Outcome, manifest: Manifest) -> dict[str, Any]:
    return {
        "task": done.name,
        "run": job.run_id,
        "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "host": platform.node(),
        "stage_s": round(done.stage_s, 6),
        "stage_cpu_s": round(done.stage_cpu_s, 6),
        "remake_s": round(done.remake_s, 6),
        "engine_s": round(done.engine_s, 6),
        "peak_bytes": done.peak_bytes,
        "nbytes": manifest.nbytes,
        "versions": versions(),
        **({"warnings": list(done.warnings)} if done.warnings else {}),
    }


def _with_task(job: Job, error: DicflowError) -> str:
    """The message of an error, with the name of its task."""
    text = str(error)
    return text if text.startswith(f"{job.task.name}:") else f"{job.task.name}: {text}"


def _defect(job: Job, error: Exception) -> str:
    """Message for an error that is not a DicflowError; the traceback goes into a file."""
    path = stop_path(job.store, job.run_id).with_name("errors") / f"{job.task.name.replace('/', '.')}.txt"
    with suppress(OSError):
        path.parent.mkdir(exist_ok=True)
        path.write_text(traceback.format_exc(), encoding="utf-8")
    hint = "not enough memory; use fewer workers" if isinstance(error, MemoryError) else f"details in {path}"
    return f"{job.task.name}: {type(error).__name__}: {str(error) or 'no message'}; {hint}"


@cache
def _store(path: Path) -> Store:
    """One store per process and folder."""
    return Store(path)


def _reset_peak() -> None:
    """Let the kernel measure the peak from here on, where it can."""
    if sys.platform == "linux":
        with suppress(OSError):
            Path("/proc/self/clear_refs").write_text("5")


def _peak() -> int:
    """Most memory that this process has held [bytes], 0 where the system does not report it."""
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return 0
