"""Pictures and tables of a result as files in a folder; what is up to date is left alone."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from dicflow._version import __version__
from dicflow.engine.references import Ref, load
from dicflow.engine.store import Store
from dicflow.io.files import make_folder, write_whole
from dicflow.io.results import csv_text, table_text
from dicflow.pipeline.result import Result

__all__ = ["publish"]

_MANIFEST = ".published.json"


class _Job(NamedTuple):
    """One piece of work: files by name below the folder, what they are made of, and the call that makes them."""

    files: tuple[str, ...]
    sources: tuple[str, ...]
    make: Callable[[], dict[str, bytes]]


def publish(result: Result, folder: Path, workers: int = 1) -> list[Path]:
    """Write the maps, comparison tables and the sweep's table of a result.

    folder : made where there is none; files whose sources have not changed since are not made again
    workers : processes that draw at once
    Returns the paths of all files, new or not.
    """
    make_folder(folder)
    manifest = folder / _MANIFEST
    made = _read(manifest)
    jobs = list(_jobs(result))
    stale = [
        job
        for job in jobs
        if any(made.get(file) != list(job.sources) or not (folder / file).is_file() for file in job.files)
    ]
    for job, contents in zip(stale, _make(stale, workers), strict=True):
        for file, content in contents.items():
            write_whole(folder / file, content)
            made[file] = list(job.sources)
    if stale:
        write_whole(manifest, json.dumps(made, indent=1).encode())
    return [folder / file for job in jobs for file in job.files]


def _jobs(result: Result) -> Iterator[_Job]:
    """All the work of a result; variants that share a product share its files."""
    seen: set[str] = set()
    for variant in range(len(result.values)):
        prefix = "" if len(result.values) == 1 else f"variant_{variant + 1}/"
        for stage in result.stages_of("maps"):
            if result.has(stage, None, variant) and (digest := result.digest(stage, None, variant)) not in seen:
                seen.add(digest)
                yield from _map_jobs(result, stage, variant, prefix)
        for stage in result.stages_of("comparison"):
            if result.has(stage, None, variant):
                yield _table_job(result, stage, variant, prefix)
    if len(result.values) > 1:
        table = result.table()
        digest = hashlib.sha256(table_text(table).encode()).hexdigest()
        yield _Job(("sweep.csv", "sweep.png"), (__version__, digest), partial(_sweep_files, list(result.values), table))


def _map_jobs(result: Result, stage: str, variant: int, prefix: str) -> Iterator[_Job]:
    """One job per quantity: a picture per step, a sheet per phase, an animation."""
    maps = result.product(stage, None, variant).attrs
    source = result.source(stage, "total", variant)
    refs = [result.ref(source, step, variant) for step in result.steps(source)]
    sources = (__version__, result.digest(stage, None, variant), *(ref.digest for ref in refs))
    for quantity in maps["quantities"]:
        base = f"{prefix}{stage}/{quantity}"
        files = _map_files(base, result.steps(source), maps["phases"])
        make = partial(_draw, result.store_folder, refs, dict(maps), quantity, base, result.steps(source))
        yield _Job(tuple(files), sources, make)


def _map_files(base: str, steps: tuple[str, ...], phases: list[str]) -> list[str]:
    sheets = [f"{base}_{phase}.png" for phase in dict.fromkeys(phases)]
    return [*sheets, f"{base}.gif", *(f"{base}/{step}.png" for step in steps)]


def _draw(
    store_folder: Path, refs: list[Ref], maps: Mapping[str, Any], quantity: str, base: str, steps: tuple[str, ...]
) -> dict[str, bytes]:
    """All pictures of one quantity by file name."""
    from dicflow.views import maps as views

    store = Store.open(store_folder)
    look = views.style(maps, quantity)
    phases = maps["phases"]
    titles = [f"{step} · {phase}" for step, phase in zip(steps, phases, strict=True)]
    frames = list(views.field_pngs((load(store, ref) for ref in refs), look, titles))
    pictures = {f"{base}/{step}.png": frame for step, frame in zip(steps, frames, strict=True)}
    for phase in dict.fromkeys(phases):
        chosen = [index for index, other in enumerate(phases) if other == phase]
        sheet = views.contact_sheet(
            [load(store, refs[index]) for index in chosen],
            [steps[index] for index in chosen],
            look,
            f"{look.title}, {phase}",
        )
        pictures[f"{base}_{phase}.png"] = views.png(sheet)
    pictures[f"{base}.gif"] = views.gif(frames)
    return pictures


def _table_job(result: Result, stage: str, variant: int, prefix: str) -> _Job:
    ref, file = result.ref(stage, None, variant), f"{prefix}{stage}.csv"
    return _Job((file,), (__version__, ref.digest), partial(_table_file, result.store_folder, ref, stage, file))


def _table_file(store_folder: Path, ref: Ref, stage: str, file: str) -> dict[str, bytes]:
    return {file: csv_text(load(Store.open(store_folder), ref), stage).encode()}


def _sweep_files(values: list[Mapping[str, Any]], table: list[dict[str, Any]]) -> dict[str, bytes]:
    from dicflow.views.maps import png
    from dicflow.views.sweep import sweep_figure

    return {"sweep.csv": table_text(table).encode(), "sweep.png": png(sweep_figure(values, table))}


def _make(jobs: list[_Job], workers: int) -> Iterator[dict[str, bytes]]:
    """Contents of the files of each job."""
    if workers == 1 or len(jobs) < 2:
        yield from (job.make() for job in jobs)
        return
    with ProcessPoolExecutor(min(workers, len(jobs)), multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(_call, [job.make for job in jobs])


def _call(make: Callable[[], dict[str, bytes]]) -> dict[str, bytes]:
    return make()


def _read(manifest: Path) -> dict[str, list[str]]:
    """What each file was made of; nothing where that is not known any more."""
    try:
        made = json.loads(manifest.read_bytes())
    except (OSError, ValueError):
        return {}
    return made if isinstance(made, dict) else {}
