"""Pictures and tables of a result as files in a folder.

What is up to date is left alone, and what an earlier result had but this one has not is taken away. A list in the
folder says which files dicflow wrote, so that files of others are left untouched.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from dicflow.engine.processes import WorkerProcesses
from dicflow.engine.references import Ref, load
from dicflow.engine.store import Store
from dicflow.engine.stored_json import is_text, list_of, mapping_of, seal, stored
from dicflow.io.files import make_folder, write_whole
from dicflow.io.results import csv_text, table_text
from dicflow.kinds.maps import Maps
from dicflow.pipeline.result import Result
from dicflow.views.source_digest import source_digest

__all__ = ["publish"]

_MANIFEST = ".published.json"
_TABLES = ("comparison", "probes", "noise")


class _Made(NamedTuple):
    """What a file was made of, and the digest of what was written."""

    sources: tuple[str, ...]
    digest: str


class _Job(NamedTuple):
    """One piece of work: files by name below the folder, what they are made of, and the call that makes them."""

    files: tuple[str, ...]
    sources: tuple[str, ...]
    make: Callable[[], dict[str, bytes]]


def publish(result: Result, folder: Path, workers: int = 1) -> list[Path]:
    """Write the maps, the tables of comparisons, probes and noise floors, and the sweep's table of a result.

    folder : made if missing; files whose sources have not changed since are not made again. Pictures of
        steps, phases and quantities that the result no longer has are deleted, unless they were changed since.
    workers : processes that draw at once
    Returns the paths of all files, new or not.
    """
    make_folder(folder)
    made = _read(folder / _MANIFEST)
    jobs = list(_jobs(result))
    files = [file for job in jobs for file in job.files]
    stale = [job for job in jobs if not all(_is_current(folder, file, job, made) for file in job.files)]
    for job, contents in zip(stale, _make(stale, workers), strict=True):
        for file, content in contents.items():
            write_whole(folder / file, content)
            made[file] = _Made(job.sources, _digest(content))
    old = [file for file in made if file not in files and file.startswith(_picture_folders(result))]
    for file in old:
        _delete(folder, file, made.pop(file))
    if stale or old:
        write_whole(folder / _MANIFEST, seal(made))
    return [folder / file for file in files]


def _is_current(folder: Path, file: str, job: _Job, made: Mapping[str, _Made]) -> bool:
    return file in made and made[file].sources == job.sources and (folder / file).is_file()


def _picture_folders(result: Result) -> tuple[str, ...]:
    """Folders of pictures, with a slash at their ends, that belong to this result alone."""
    variants = range(len(result.values))
    return tuple(
        f"{_prefix(result, variant)}{stage}/"
        for variant in variants
        for stage in result.stages_of("maps")
        if result.has(stage, None, variant)
    )


def _delete(folder: Path, file: str, made: _Made) -> None:
    """Delete a file that is still as it was written, and its folder if that is empty then."""
    path = folder / file
    with suppress(OSError):
        if path.resolve().is_relative_to(folder.resolve()) and _digest(path.read_bytes()) == made.digest:
            path.unlink()
            path.parent.rmdir()


def _jobs(result: Result) -> Iterator[_Job]:
    """All the work of a result; variants that share a product share its files."""
    seen: set[str] = set()
    for variant in range(len(result.values)):
        prefix = _prefix(result, variant)
        for stage in result.stages_of("maps"):
            if result.has(stage, None, variant) and (digest := result.digest(stage, None, variant)) not in seen:
                seen.add(digest)
                yield from _map_jobs(result, stage, variant, prefix)
        for stage in (stage for kind in _TABLES for stage in result.stages_of(kind)):
            if result.has(stage, None, variant):
                yield _table_job(result, stage, variant, prefix)
    if len(result.values) > 1:
        table = result.table()
        sources = (_code(), _digest(table_text(table).encode()))
        yield _Job(("sweep.csv", "sweep.png"), sources, partial(_sweep_files, list(result.values), table))


def _prefix(result: Result, variant: int) -> str:
    """Folder of a variant with a slash at its end; empty if there is only one variant."""
    return "" if len(result.values) == 1 else f"variant_{variant + 1}/"


def _map_jobs(result: Result, stage: str, variant: int, prefix: str) -> Iterator[_Job]:
    """One job per quantity: a picture per step, a sheet per phase, an animation."""
    maps = Maps.read(result.product(stage, None, variant))
    source = result.source(stage, "total", variant)
    steps = result.steps(source, variant)
    refs = [result.ref(source, step, variant) for step in steps]
    sources = (_code(), result.digest(stage, None, variant), *(ref.digest for ref in refs))
    for quantity in maps.quantities:
        base = f"{prefix}{stage}/{quantity}"
        files = _map_files(base, steps, maps.phases)
        make = partial(_draw, result.store_folder, refs, result.ref(stage, None, variant), quantity, base, steps)
        yield _Job(tuple(files), sources, make)


def _map_files(base: str, steps: tuple[str, ...], phases: Sequence[str]) -> list[str]:
    sheets = [f"{base}_{phase}.png" for phase in dict.fromkeys(phases)]
    return [*sheets, f"{base}.gif", *(f"{base}/{step}.png" for step in steps)]


def _draw(
    store_folder: Path, refs: list[Ref], maps_ref: Ref, quantity: str, base: str, steps: tuple[str, ...]
) -> dict[str, bytes]:
    """All pictures of one quantity by file name."""
    from dicflow.views import maps as views

    store = Store.open(store_folder)
    maps = Maps.read(load(store, maps_ref))
    look, window = views.map_look(maps, quantity), views.map_window(maps)
    phases = maps.phases
    titles = [f"{step} · {phase}" for step, phase in zip(steps, phases, strict=True)]
    frames = list(views.field_pngs((load(store, ref) for ref in refs), look, window, titles))
    pictures = {f"{base}/{step}.png": frame for step, frame in zip(steps, frames, strict=True)}
    for phase in dict.fromkeys(phases):
        chosen = [index for index, other in enumerate(phases) if other == phase]
        sheet = views.contact_sheet(
            [load(store, refs[index]) for index in chosen],
            [steps[index] for index in chosen],
            look,
            window,
            f"{look.title}, {phase}",
        )
        pictures[f"{base}_{phase}.png"] = views.png(sheet)
    pictures[f"{base}.gif"] = views.gif(frames)
    return pictures


def _table_job(result: Result, stage: str, variant: int, prefix: str) -> _Job:
    ref, file = result.ref(stage, None, variant), f"{prefix}{stage}.csv"
    return _Job((file,), (_code(), ref.digest), partial(_table_file, result.store_folder, ref, stage, file))


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
    with WorkerProcesses(min(workers, len(jobs))) as processes:
        yield from processes.map(_call, [job.make for job in jobs])


def _call(make: Callable[[], dict[str, bytes]]) -> dict[str, bytes]:
    return make()


def _code() -> str:
    """Digest of the code that draws and writes."""
    return source_digest("io", "views")


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _read(manifest: Path) -> dict[str, _Made]:
    """The record of each file; empty if the list is damaged or missing."""
    found = stored(manifest, mapping_of(_is_made)) or {}
    return {file: _Made(tuple(sources), digest) for file, (sources, digest) in found.items()}


def _is_made(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and list_of(is_text)(value[0]) and is_text(value[1])
